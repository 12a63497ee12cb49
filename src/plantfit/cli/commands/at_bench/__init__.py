"""Commands at the bench: make an excitation, play it and record."""
