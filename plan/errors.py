"""Errors of the planner: the user's mistakes, each with its place and its remedy."""

from __future__ import annotations

from ident.errors import InputError


class SceneError(InputError):
    """The scene file, or a file of via points, can't be used."""


class TaskError(InputError):
    """The task can't be set with this arm: a start or goal out of limits or in collision, another robot's model."""


class MethodError(InputError):
    """No such method, objective or metric, or a method that can't do this task."""
