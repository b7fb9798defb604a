"""Energy- and time-optimal, collision-free motions on an identified arm.

    from plan import solve
    print(solve("scene.toml", "model").summary())

Each name is loaded when it is first asked for, so that importing the package costs nothing.
"""

from ident import lazily

TYPE_CHECKING = False  # `typing` itself would take longer to load than all of this
if TYPE_CHECKING:
    from plan.api.cycles import cycle as cycle
    from plan.api.exciting import excite as excite
    from plan.api.planning import compare as compare
    from plan.api.planning import solve as solve
    from plan.planners.base import Planner as Planner
    from plan.problem.result import PlanResult as PlanResult
    from plan.problem.task_file import load_task as load_task

__getattr__, __dir__, __all__ = lazily(__name__, __file__)
