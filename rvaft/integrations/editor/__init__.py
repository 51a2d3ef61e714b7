"""Support for editors: a language server, and highlighting for Pygments and TextMate."""
