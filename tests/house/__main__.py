"""Print the sizes of the house: `make sizes`. They are a report, and nothing depends on them."""

from tests.house.numbers import measured, sizes

for name, (lines, code, words) in sizes().items():
    print(f"{lines:8,} lines {code:8,} of code {words:8,} words  {name}")
for name, value in measured().items():
    print(f"{value:8,}  {name}")
