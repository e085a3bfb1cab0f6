"""Which kernels are compiled, and for how many kinds of arguments."""

import sys


def signatures():
    """Number of signatures by kernel, of the modules that are loaded."""
    return {
        f"{name}.{key}": len(value.signatures)
        for name, module in list(sys.modules.items())
        if ".kernels." in name and name.split(".")[0] in {"maps", "localization", "planner"}
        for key, value in vars(module).items()
        if hasattr(value, "signatures")
    }
