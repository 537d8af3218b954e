"""Registers the environments by a name that is only ours: `make("proxemic_benchmark:Proxemic/S1-v0")`."""

import envs

if not hasattr(envs, "ProxemicEnv"):
    raise ImportError(f"{envs} hides this project's package envs; rename it or start Python elsewhere.")
