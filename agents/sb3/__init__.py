"""Algorithms of Stable-Baselines3 (Raffin et al. 2021), and of any package with classes like its own."""

import os
from contextlib import suppress

# With AVX-512, sums of MKL have another order for another number of rows, and torch takes another code. Both
# look at these when they are first used, in training or before: so they are set when `agents` is imported.
with suppress(ModuleNotFoundError):  # without numba, nothing is trained
    import llvmlite.binding

    if llvmlite.binding.get_host_cpu_features().get("avx2"):
        os.environ.setdefault("MKL_CBWR", "AVX2")
        os.environ.setdefault("ATEN_CPU_CAPABILITY", "avx2")
