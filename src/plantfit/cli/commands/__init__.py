"""The work of each command, one file for each or for a few that belong together; `cli/options/` says what they take."""
