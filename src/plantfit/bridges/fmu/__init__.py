"""The plant as a Functional Mock-up Unit (FMI 2.0): its description, its C, and the archive of both with a compiled
binary."""
