"""Identification of robot arms and diagnosis of the gap between an arm and its model.

    from ident import diagnose
    print(diagnose("my_session", "my_arm.urdf").summary())

Each name is loaded when it is first asked for, so that importing the package costs nothing.
"""

from ident.lazy import lazily

TYPE_CHECKING = False  # `typing` itself would take longer to load than all of this
if TYPE_CHECKING:
    from ident.api.comparing import compare as compare
    from ident.api.daily import new as new
    from ident.api.daily import ranges as ranges
    from ident.api.daily import servo as servo
    from ident.api.daily import watch as watch
    from ident.api.diagnosing import diagnose as diagnose
    from ident.api.exporting import patch as patch
    from ident.api.exporting import verify as verify
    from ident.api.fitting import evaluate as evaluate
    from ident.api.fitting import fit as fit
    from ident.api.fitting import fit_hybrid as fit_hybrid
    from ident.api.fitting import view as view
    from ident.api.inspecting import inspect as inspect
    from ident.api.simulating import blind as blind
    from ident.api.simulating import close as close
    from ident.api.simulating import plant as plant
    from ident.api.simulating import simulate as simulate
    from ident.diagnosis.result import Diagnosis as Diagnosis
    from ident.diagnosis.settings import DiagnosisSettings as DiagnosisSettings
    from ident.effects.base import Effect as Effect
    from ident.errors import InputError as InputError
    from ident.model.hybrid import FitOptions as FitOptions
    from ident.model.hybrid import HybridModel as HybridModel
    from ident.progress import listening as listening
    from ident.recordings.recording import Recording as Recording
    from ident.recordings.recording import Session as Session
    from ident.robot.arm import ArmModel as ArmModel
    from ident.sessions import open_sessions as open_sessions

__getattr__, __dir__, __all__ = lazily(__name__, __file__)
