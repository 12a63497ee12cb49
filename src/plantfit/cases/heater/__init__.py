"""A board with two heaters (Temperature Control Lab): dead time of one, energy balances of both."""
