"""The simulator in a browser: the package's own kernels as a WebAssembly module, and the JavaScript around it."""
