"""Algorithms of Stable-Baselines3 (Raffin et al. 2021), and of any package with classes like its own."""

import os


def use_same_instructions() -> None:
    """Sets variables of this process with which SB3's agents are alike on processors with AVX2 and AVX-512.

    With AVX-512, sums of MKL have another order for another number of rows, and torch takes another code.
    Both look at these when they are first used: call it before, in a process that only trains.
    """
    import llvmlite.binding  # which `import agents` does without

    if llvmlite.binding.get_host_cpu_features().get("avx2"):
        os.environ.setdefault("MKL_CBWR", "AVX2")
        os.environ.setdefault("ATEN_CPU_CAPABILITY", "avx2")
