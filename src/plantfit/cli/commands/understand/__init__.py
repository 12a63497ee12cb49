"""Commands that say what a fit is worth: what is missing, what is better, whether recordings agree, intervals,
sensitivities."""
