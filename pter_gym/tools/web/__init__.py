"""The simulator in a browser: the package's kernels as WebAssembly, and the page around them."""
