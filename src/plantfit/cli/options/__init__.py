"""What each command takes, and its line in `plantfit --help`: a file for each section of it; the work is in `cli/commands/`."""
