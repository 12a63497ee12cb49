"""The function that XLA calls, by its C interface for foreign functions (xla/ffi/api/c_api.h)."""


def handler(inputs: int, outputs: int) -> str:
    """LLVM text of `entry`: answers a query for the version of the interface, else calls `kernel` on the buffers of the frame.

    Offsets are those of XLA_FFI_CallFrame, XLA_FFI_Metadata_Extension and XLA_FFI_Buffer. The first argument holds the sizes
    K, G and B, and the steps of every group where they differ.
    """
    lines = [
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
        "  %ap = getelementptr i8, ptr %frame, i64 16",
        "  %api = load ptr, ptr %ap",
        "  %vp = getelementptr i8, ptr %api, i64 32",
        "  %version = load i64, ptr %vp, align 4",
        "  %mp = getelementptr i8, ptr %extension, i64 24",
        "  %answer = load ptr, ptr %mp",
        "  %wp = getelementptr i8, ptr %answer, i64 24",
        "  store i64 %version, ptr %wp, align 4",
        "  %rp = getelementptr i8, ptr %answer, i64 32",
        "  store i32 0, ptr %rp",
        "  ret ptr null",
        "run:",
        "  %args_at = getelementptr i8, ptr %frame, i64 72",
        "  %args = load ptr, ptr %args_at",
        "  %rets_at = getelementptr i8, ptr %frame, i64 112",
        "  %rets = load ptr, ptr %rets_at",
    ]

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
