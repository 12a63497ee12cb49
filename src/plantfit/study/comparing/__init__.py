"""Statistics of the runs of several methods: pairwise tests, profiles, targets, Friedman, sentences, the record."""
