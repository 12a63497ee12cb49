"""Commands before there is a fit: demos, a first study file, a look at a recording, and a check of a study file."""
