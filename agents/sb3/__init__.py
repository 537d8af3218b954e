"""Algorithms of Stable-Baselines3 (Raffin et al. 2021), and of packages with classes like it."""

import os


def use_same_instructions() -> None:
    """Keeps MKL and torch from AVX-512, whose sums differ, in a process that only trains.

    Call it first.
    """
    import llvmlite.binding  # which `import agents` does without

    if llvmlite.binding.get_host_cpu_features().get("avx2"):
        os.environ.setdefault("MKL_CBWR", "AVX2")
        os.environ.setdefault("ATEN_CPU_CAPABILITY", "avx2")
