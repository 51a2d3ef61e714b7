"""Write the bars anew where a number has fallen: `python -m tests.house`. A bar is never raised here."""

import json

from tests.house.numbers import TABLE, bars, measured

old = bars()
new = {name: min(value, old.get(name, value)) for name, value in measured().items()}
TABLE.write_text(json.dumps(new, indent=2) + "\n", encoding="utf-8")
for name, value in new.items():
    print(f"{value:8,}  {name}" + (f" (was {old[name]:,})" if old.get(name, value) != value else ""))
