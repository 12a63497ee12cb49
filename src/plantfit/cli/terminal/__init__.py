"""How commands speak: results, progress, live plots, Ctrl-C, and what is said when a command fails."""
