"""Study files written anew from what a fit found: in combinations, in pieces, with additions to the model."""
