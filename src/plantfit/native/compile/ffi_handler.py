"""The function that XLA calls, by its C interface for foreign functions (xla/ffi/api/c_api.h)."""

# The version of the interface that the offsets below were written for: XLA refuses a handler of one that it does not
# serve. jaxlib 0.8.1 to 0.9 have 0.2, jaxlib 0.10 has 0.3, jaxlib 0.12 has 0.5, and both serve 0.2 too.
VERSION = (0, 2)
# sizeof, as c_api.h counts them, of XLA_FFI_CallFrame, _Args, _Rets and _Buffer
SIZES = (168, 40, 40, 48)


def handler(inputs: int, outputs: int) -> str:
    """LLVM text of `entry`: answers a query for the version of the interface, else calls `kernel` on the buffers of the
    frame.

    Offsets are those of XLA_FFI_CallFrame, XLA_FFI_Metadata_Extension and XLA_FFI_Buffer. The first argument holds the
    sizes K, G and B, and the steps of every group where they differ.
    """
    lines = _begun()

    def buffer(name: str, array: str, i: int) -> None:
        lines.append(f"  %{name}_a = getelementptr ptr, ptr %{array}, i64 {i}")
        lines.append(f"  %{name}_b = load ptr, ptr %{name}_a")
        lines.append(f"  %{name}_c = getelementptr i8, ptr %{name}_b, i64 24")
        lines.append(f"  %{name} = load ptr, ptr %{name}_c")

    buffer("sizes", "args", 0)
    for i in range(inputs):
        buffer(f"in{i}", "args", i + 1)
    for i in range(outputs):
        buffer(f"out{i}", "rets", i)
    for i, name in enumerate("KGB"):
        lines.append(f"  %{name}_at = getelementptr i64, ptr %sizes, i64 {i}")
        lines.append(f"  %{name} = load i64, ptr %{name}_at")
    passed = [f"ptr %in{i}" for i in range(inputs)] + [f"ptr %out{i}" for i in range(outputs)]
    lines.append(f"  call void @kernel({', '.join([*passed, 'ptr %sizes', 'i64 %K', 'i64 %G', 'i64 %B'])})")
    return "\n".join([*lines, "  ret ptr null", "}"])


def size_probe() -> str:
    """LLVM text of an `entry` with one input of 4 int64: it writes there the sizes that XLA gives the four structs of
    `SIZES`.

    A later struct is read only where the size of the one that points to it is as expected.
    """
    lines = ["attributes #0 = { nounwind }", "@seen = global [4 x i64] zeroinitializer", *_begun()]
    places = ("%frame", 0), ("%frame", 40), ("%frame", 80), ("%b", 0)
    for k, ((base, offset), size) in enumerate(zip(places, SIZES, strict=True)):
        if base == "%b":
            lines += ["  %b = load ptr, ptr %args"]
        lines += [
            f"  %a{k} = getelementptr i8, ptr {base}, i64 {offset}",
            f"  %s{k} = load i64, ptr %a{k}",
            f"  %w{k} = getelementptr i64, ptr @seen, i64 {k}",
            f"  store i64 %s{k}, ptr %w{k}",
            f"  %ok{k} = icmp eq i64 %s{k}, {size}",
            f"  br i1 %ok{k}, label %next{k}, label %out",
            f"next{k}:",
        ]
    return "\n".join([*lines, "  br label %out", "out:", "  ret ptr null", "}"])


def _begun() -> list[str]:
    """Up to the addresses of the arrays of arguments and results."""
    major, minor = VERSION
    return [
        "define ptr @entry(ptr %frame) #0 {",
        "  %xp = getelementptr i8, ptr %frame, i64 8",
        "  %extension = load ptr, ptr %xp",
        "  %asks = icmp ne ptr %extension, null",
        "  br i1 %asks, label %maybe, label %run",
        "maybe:",
        "  %tp = getelementptr i8, ptr %extension, i64 8",
        "  %type = load i32, ptr %tp",
        "  %is = icmp eq i32 %type, 1",
        "  br i1 %is, label %metadata, label %run",
        "metadata:",
        "  %mp = getelementptr i8, ptr %extension, i64 24",
        "  %answer = load ptr, ptr %mp",
        "  %map = getelementptr i8, ptr %answer, i64 24",
        f"  store i32 {major}, ptr %map",
        "  %mip = getelementptr i8, ptr %answer, i64 28",
        f"  store i32 {minor}, ptr %mip",
        "  %rp = getelementptr i8, ptr %answer, i64 32",
        "  store i32 0, ptr %rp",
        "  ret ptr null",
        "run:",
        "  %args_at = getelementptr i8, ptr %frame, i64 72",
        "  %args = load ptr, ptr %args_at",
        "  %rets_at = getelementptr i8, ptr %frame, i64 112",
        "  %rets = load ptr, ptr %rets_at",
    ]
