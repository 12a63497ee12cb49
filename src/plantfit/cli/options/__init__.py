"""What each command takes, and its line in `plantfit --help`: a file for each section of it.

A command is a function here and a row of `COMMANDS` in the same file. Its line fits 80 columns. It imports its work
from the sub-room of `cli/commands/` that has the name of the file, and does so inside the function, so that other
commands do not wait for it. Both are held by `tests/cli/test_cli_overview.py`.
"""
