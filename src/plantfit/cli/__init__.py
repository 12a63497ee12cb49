"""The commands: `options/` says what each takes, `commands/` does the work, `main.py` is where the program begins."""
