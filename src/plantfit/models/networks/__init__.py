"""Plants from parts: `netlist.py` reads their list, `laws.py` and `balances.py` make equations of it, `ordering.py`
and `loops.py` solve them for rates and outputs, and `network.py` is the result; `parts.py` lists what there is."""
