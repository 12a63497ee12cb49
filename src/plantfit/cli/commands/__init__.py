"""One file for each command, or for a few that belong together; `cli/main.py` lists them all."""
