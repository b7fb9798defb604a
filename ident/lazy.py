"""Names of a package that are loaded when they are first asked for (PEP 562): a help text loads no physics."""

from __future__ import annotations

TYPE_CHECKING = False  # `typing` itself would take longer to load than all of this
if TYPE_CHECKING:
    from collections.abc import Callable
    from typing import Any


def lazily(package: str, file: str) -> tuple[Callable[[str], Any], Callable[[], list[str]], list[str]]:
    """The module functions `__getattr__` and `__dir__` of a package, and its `__all__`.

    Its names stand once, where type checkers read them: each in a line `from HOME import NAME as NAME`.

    Args:
        package: Name of the package.
        file: Its source.
    """
    with open(file, encoding="utf-8") as source:
        lines = [line.split() for line in source if line.startswith("    from ") and " as " in line]
    homes = {name: home for _, home, _, name, *_ in lines}

    def load(name: str) -> Any:
        if name not in homes:
            raise AttributeError(f"module {package!r} has no attribute {name!r}; it has: {', '.join(sorted(homes))}")
        from importlib import import_module

        return getattr(import_module(homes[name]), name)

    return load, lambda: sorted(homes), sorted(homes)
