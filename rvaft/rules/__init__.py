"""The rules of `rvaft check`, one function each; its docstring states what the rule requires."""
