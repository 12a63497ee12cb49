"""From the graph to LLVM text: the kernel and the code of its regions."""
