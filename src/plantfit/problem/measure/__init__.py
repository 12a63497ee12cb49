"""What a recording tells a problem: samples to fit, holds of inputs, noise, where tables are used."""
