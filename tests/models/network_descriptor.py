"""An independent way from a list of linear parts to its response: a descriptor system in numbers, solved at one
frequency at a time."""

import numpy as np

KINDS = {  # part: (does it set or store across, through, or resist), as numbers need it
    "resistor": "R", "capacitor": "C", "inductor": "L", "source": "V", "current_source": "I",
}  # fmt: skip


def pencil(parts, values):
    """(E, A, B, nodes, branches) of E z' = A z + B u: z holds potentials of nodes, then currents of capacitors' and
    other branches.

    parts: (name, kind, a, b); u: the sources in their order.
    """
    nodes = sorted({n for _, _, a, b in parts for n in (a, b)} - {"0"})
    sources = [name for name, kind, _, _ in parts if KINDS[kind] in "VI"]
    n, m = len(nodes), len(parts)
    e, a_, b_ = np.zeros((n + m, n + m)), np.zeros((n + m, n + m)), np.zeros((n + m, len(sources)))
    for k, (name, kind, first, second) in enumerate(parts):
        row = n + k
        ends = [(sign, nodes.index(node)) for sign, node in ((1, first), (-1, second)) if node != "0"]
        law, value = KINDS[kind], values.get(name, 1.0)
        out = -1 if law == "V" else 1  # a source gives at its first node
        for sign, node in ends:
            a_[node, row] += out * sign
            if law in "RLV":
                a_[row, node] += sign
            if law == "C":
                e[row, node] += value * sign
        if law == "R":
            a_[row, row] -= value
        elif law == "L":
            e[row, row] = value
        elif law == "C":
            a_[row, row] = 1.0
        else:
            a_[row, row] -= law == "I"
            b_[row, sources.index(name)] = -1.0 if law == "V" else 1.0
    return e, a_, b_, nodes, sources


def response(parts, values, node, source, s):
    """From a source to the potential of a node, at the complex frequency s."""
    e, a, b, nodes, sources = pencil(parts, values)
    return np.linalg.solve(s * e - a, b[:, sources.index(source)])[nodes.index(node)]
