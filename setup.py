"""What pyproject.toml cannot say: the replay kernel, compiled if a compiler is there.

It is plain C without Python in it, so that it needs no headers of Python and serves every version;
`planner.machine.compiled` loads it. The wheel's tag says so: built by one Python, it installs on
all from `OLDEST` on.
"""

from __future__ import annotations

import zlib
from pathlib import Path
from typing import Any

from setuptools import Extension, setup
from setuptools.command.build_ext import build_ext

OLDEST = "cp311"

UNIX = ["-std=c99", "-O3", "-fvisibility=hidden", "-fno-math-errno", "-ffp-contract=off"]


class Build(build_ext):
    """Flags by compiler, and no init function of a Python module among the exports."""

    def build_extension(self, ext: Extension) -> None:
        """Build with the flags of the compiler at hand."""
        if self.compiler.compiler_type != "msvc":
            ext.extra_compile_args = UNIX
        super().build_extension(ext)

    def get_export_symbols(self, ext: Extension) -> Any:
        """What the kernel exports says the kernel itself."""
        return ext.export_symbols


SOURCES = [f"planner/machine/{name}.c" for name in ("kernel", "wide", "dynamic")]
HEADERS = [
    f"planner/machine/{name}.h" for name in ("functions", "lanes", "contacts", "chain", "layout")
]
CHECKSUM = zlib.crc32(b"".join(Path(name).read_bytes() for name in SOURCES + HEADERS))

KERNEL = Extension(
    "planner.machine._kernel",
    SOURCES,
    depends=HEADERS,
    define_macros=[("SOURCE", str(CHECKSUM))],
    py_limited_api=True,
    optional=True,
)

setup(
    ext_modules=[KERNEL],
    cmdclass={"build_ext": Build},
    options={"bdist_wheel": {"py_limited_api": OLDEST}},
)
