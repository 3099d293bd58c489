"""What decides whether two computers compute the same bits: versions, processor features, a small result."""

import hashlib
import math
import os
import platform
from importlib.metadata import PackageNotFoundError, version

import numpy as np

PACKAGES = ("numpy", "numba", "llvmlite", "scipy", "protobuf")
COMPILER = (
    "NUMBA_CPU_NAME",
    "NUMBA_CPU_FEATURES",
    "NUMBA_ENABLE_AVX",
    "NUMBA_OPT",
    "NUMBA_LOOP_VECTORIZE",
    "NUMBA_SLP_VECTORIZE",
    "NUMBA_DISABLE_INTEL_SVML",
    "NUMBA_DISABLE_JIT",
)
"""Variables that make other machine code of the kernels than this processor's own."""


def numeric_fingerprint() -> dict[str, str]:
    """Return the versions, the processor features in use and a hash of a few elementary functions.

    Equal fingerprints promise equal signal digests from equal inputs; unequal ones promise nothing.
    """
    simd = np.show_config(mode="dicts")["SIMD Extensions"]
    features = " ".join([*simd.get("baseline", []), *simd.get("found", [])])
    return {
        "python": platform.python_version(),
        **{name: _version(name) for name in PACKAGES},
        "machine": platform.machine(),
        "libc": " ".join(platform.libc_ver()),
        "features": features,
        "target": " ".join(f"{name}={os.environ[name]}" for name in COMPILER if name in os.environ) or "host",
        "functions": _functions(),
    }


def _version(package: str) -> str:
    try:
        return version(package)
    except PackageNotFoundError:
        return "none"


def _functions() -> str:
    """Return a hash of the functions whose last bit differs between processors and libraries."""
    values = np.linspace(-7.0, 7.0, 257)
    digest = hashlib.sha256()
    for function in (np.sin, np.cos, np.exp, np.arctan, np.tanh):
        digest.update(function(values).tobytes())
    alone = [function(value) for function in (math.sin, math.exp, math.atan) for value in values.tolist()]
    digest.update(np.array(alone).tobytes())
    return digest.hexdigest()[:16]
