"""The work of each command: a sub-room for each section of `plantfit --help`, under the name of its file in
`cli/options/`."""
