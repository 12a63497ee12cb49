"""Commands on what stores hold: studies out, in and together, and the workers on them."""
