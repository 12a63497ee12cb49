"""Commands that run studies, list them and report them, and that simulate a fitted model."""
