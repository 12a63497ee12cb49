"""The commands; `main.py` declares them."""
