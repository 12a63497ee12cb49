"""Commands at the bench: make an excitation, play it and record, follow a plant, record a virtual one."""
