"""The state of a function being emitted: registers of nodes, memory of arrays, active lanes."""

from collections.abc import Callable, Generator, Mapping, Sequence
from contextlib import contextmanager

from plantfit.native.emit.llvm_text import BYTES, MEMORY, REGISTER, FunctionText, Lanes, literal
from plantfit.native.emit.storage import Storage
from plantfit.native.graph.nodes import Node
from plantfit.native.unsupported import StackExceeded

STACK = 1 << 19  # bytes of arrays that one call may keep on the stack


class Emitter(FunctionText):
    """`varies` tells whether a node differs between lanes; `constant_storage` finds the memory of a `constant` node."""

    def __init__(
        self, width: int, vectors: int, varies: Callable[[Node], bool], constant_storage: Callable[[Node], Storage]
    ):
        super().__init__(width, vectors)
        self.varies = varies
        self.mask: Lanes | None = None  # of the active lanes; None: all
        self.libm: dict[str, int] = {}  # C functions that are called, with their argument counts
        self.before_steps: list[str] = []  # stores that a block runs ahead of its first step
        self._values: dict[Node, Lanes] = {}
        self._arrays: dict[Node, Storage] = {}
        self._constant_storage = constant_storage
        self._stack = 0

    # -- registers ----------------------------------------------------------------------------------

    def define(self, node: Node, values: Lanes) -> None:
        """Bind a node to its registers: one per vector, or a single scalar when it does not vary."""
        self._values[node] = values

    def value(self, node: Node) -> Lanes:
        """The registers of a node as they were defined."""
        return self._values[node]

    def lanes(self, node: Node) -> Lanes:
        """One vector operand per vector; a uniform number is broadcast."""
        if node.op == "const":
            return [f"splat ({REGISTER[node.dtype]} {literal(node)})"] * self.vectors
        if self.varies(node):
            return self._values[node]
        return self.block(REGISTER[node.dtype], self._values[node][0])

    def uniform(self, node: Node) -> str:
        """The scalar operand of a node that does not vary."""
        return literal(node) if node.op == "const" else self._values[node][0]

    def operand(self, node: Node, varying: bool) -> Lanes:
        """Vector operands, or the scalar one alone."""
        return self.lanes(node) if varying else [self.uniform(node)]

    def operands(self, nodes: Sequence[Node], varying: bool) -> list[list[str]]:
        """[vector][argument]; a single row when nothing varies."""
        return [list(row) for row in zip(*(self.operand(n, varying) for n in nodes), strict=True)]

    # -- active lanes -------------------------------------------------------------------------------

    @contextmanager
    def active(self, masks: Lanes | None) -> Generator[None]:
        """Within, only these lanes are active."""
        before, self.mask = self.mask, masks
        yield
        self.mask = before

    def active_among(self, masks: Lanes) -> Lanes:
        """The lanes of the masks that are active."""
        return masks if self.mask is None else self.both(masks, self.mask)

    def any_lane(self, masks: Lanes) -> str:
        """i1: whether the masks hold an active lane."""
        masks = self.active_among(masks)
        total = masks[0]
        for other in masks[1:]:
            total = self.put(f"or {self.vector('i1')} {total}, {other}")
        return self.some_lane(total)

    def some_lane(self, mask: str) -> str:
        """i1: whether a mask is true anywhere."""
        return self.call("i1", f"llvm.vector.reduce.or.v{self.width}i1", (self.vector("i1"), mask))

    # -- one vector ---------------------------------------------------------------------------------

    @contextmanager
    def one_vector(self, values: Mapping[Node, str]) -> Generator[None]:
        """Within, a block has one vector, in which nodes from outside have these values."""
        vectors, before = self.vectors, {node: self._values[node] for node in values}
        self.vectors = 1
        self._values.update({node: [value] for node, value in values.items()})
        yield
        self.vectors = vectors
        self._values.update(before)

    @contextmanager
    def each_vector(self, some: Lanes) -> Generator[str]:
        """Within, one vector of a block after another is worked off, those whose i1 is true; the place."""
        bits = self.put(f"zext i1 {some[0]} to i64")
        for u, one in enumerate(some[1:], 1):
            bit = self.put(f"select i1 {one}, i64 {1 << u}, i64 0")
            bits = self.put(f"or i64 {bits}, {bit}")
        # from bit to bit, so that no vector that is left out takes a branch
        (left,) = self.filled_slots("i64", [bits])
        head, body, end = (self.name(stem) for stem in ("vectors", "vector", "done"))
        self.line(f"br label %{head}")
        self.label(head)
        bits = self.put(f"load i64, ptr {left}")
        self.line(f"br i1 {self.put(f'icmp eq i64 {bits}, 0')}, label %{end}, label %{body}")
        self.label(body)
        u = self.call("i64", "llvm.cttz.i64", ("i64", bits), ("i1", "true"))
        yield u
        fewer = self.put(f"sub i64 {bits}, 1")
        self.line(f"store i64 {self.put(f'and i64 {bits}, {fewer}')}, ptr {left}")
        self.line(f"br label %{head}")
        self.label(end)

    # -- memory -------------------------------------------------------------------------------------

    def bind(self, node: Node, storage: Storage) -> None:
        """Bind an array node to its memory."""
        self._arrays[node] = storage

    def storage(self, node: Node) -> Storage:
        """The memory of an array node."""
        if node not in self._arrays and node.op == "constant":
            self._arrays[node] = self._constant_storage(node)
        return self._arrays[node]

    def reserve(self, dtype: str, size: int, flat: bool) -> Storage:
        """New memory on the stack; raises StackExceeded when the arrays exceed STACK bytes."""
        count = size if flat else size * self.vectors * self.width
        self._stack += count * BYTES[dtype]
        if self._stack > STACK:
            raise StackExceeded(f"arrays of {self._stack} bytes inside a loop")
        return Storage(self.slot(MEMORY[dtype], count), dtype, size, flat)
