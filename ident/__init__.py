"""Identification of robot arms and diagnosis of the gap between an arm and its model.

    from ident import diagnose
    print(diagnose("my_session", "my_arm.urdf").summary())

Each name is loaded when it is first asked for (PEP 562), so that importing the package costs
nothing.
"""

from __future__ import annotations

TYPE_CHECKING = False  # `typing` itself would take longer to load than all of this
if TYPE_CHECKING:
    from collections.abc import Callable
    from typing import Any

    from ident.api.daily import new as new
    from ident.api.daily import ranges as ranges
    from ident.api.daily import servo as servo
    from ident.api.daily import watch as watch
    from ident.api.diagnosing import compare as compare
    from ident.api.diagnosing import diagnose as diagnose
    from ident.api.exporting import patch as patch
    from ident.api.exporting import verify as verify
    from ident.api.fitting import evaluate as evaluate
    from ident.api.fitting import fit as fit
    from ident.api.fitting import fit_hybrid as fit_hybrid
    from ident.api.fitting import view as view
    from ident.api.inspecting import inspect as inspect
    from ident.api.planting import check_effect as check_effect
    from ident.api.planting import plant as plant
    from ident.api.simulating import blind as blind
    from ident.api.simulating import close as close
    from ident.api.simulating import simulate as simulate
    from ident.command_options import FitOptions as FitOptions
    from ident.diagnosis.result import Diagnosis as Diagnosis
    from ident.diagnosis.settings import DiagnosisSettings as DiagnosisSettings
    from ident.effects.base import Effect as Effect
    from ident.errors import InputError as InputError
    from ident.model.hybrid import HybridModel as HybridModel
    from ident.progress import listening as listening
    from ident.recordings.recording import Recording as Recording
    from ident.recordings.recording import Session as Session
    from ident.robot.arm import ArmModel as ArmModel
    from ident.sessions import open_sessions as open_sessions


def lazily(
    package: str, file: str
) -> tuple[Callable[[str], Any], Callable[[], list[str]], list[str]]:
    """The module functions `__getattr__` and `__dir__` of a package, and its `__all__`.

    Its names stand once, where type checkers read them: each in a line `from HOME import NAME as
    NAME`.

    Args:
        package: Name of the package.
        file: Its source.
    """
    with open(file, encoding="utf-8") as source:
        lines = [line.split() for line in source if line.startswith("    from ") and " as " in line]
    homes = {name: home for _, home, _, name, *_ in lines}

    def load(name: str) -> Any:
        if name not in homes:
            raise AttributeError(
                f"module {package!r} has no attribute {name!r}; it has: {', '.join(sorted(homes))}"
            )
        from importlib import import_module

        return getattr(import_module(homes[name]), name)

    return load, lambda: sorted(homes), sorted(homes)


__getattr__, __dir__, __all__ = lazily(__name__, __file__)
