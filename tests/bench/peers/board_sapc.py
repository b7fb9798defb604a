"""SAPC's rule on a board: groups of physical coefficients, chosen by cross-validation, or none at all.

"Fidelity is not identification" (2026) fits changes of inertia, friction and armature to a model's torque error, in
groups; a group enters where runs left out ask for it, and "no correction" is an answer. Written from a summary of the
paper (112 coefficients in 15 groups, cross-validated group selection, an edit test that deletes the named payload
without a refit), not from its text: its authors may correct it here. Groups are a link's ten parameters, and rotor,
viscous and Coulomb friction of all joints; offsets are a nuisance of every fit. The model is the URDF, or where the
arm before is given what plain least squares find there.
"""

import numpy as np
from board_entry import columns, enter, rows_of, states, weighted_fit, write_answer, write_torque

FOLDS, RIDGE, SURE = 5, 1e-3, 0.5
# A group enters where held-out squares fall by more than their standard error over folds.
ERRORS = 1.0


def groups_of(n):
    """Columns of each group by its name."""
    links = {f"link {j}": np.arange(10 * j, 10 * j + 10) for j in range(n)}
    kinds = ("rotor", "viscous", "coulomb")
    return links | {kind: np.arange((10 + k) * n, (11 + k) * n) for k, kind in enumerate(kinds)}


def solve(gram, chosen):
    """Ridge in units of each column's power."""
    a = gram[np.ix_(chosen, chosen)]
    return np.linalg.solve(a + RIDGE * np.diag(np.diag(a) + 1e-9), gram[chosen, -1])


def left(gram, chosen, found):
    return gram[-1, -1] - 2.0 * gram[-1, chosen] @ found + found @ gram[np.ix_(chosen, chosen)] @ found


def model_of(session):
    if session.before is not None:
        return weighted_fit(*rows_of(session, session.runs_of_model()))
    bodies = [inertia.toDynamicParameters() for inertia in list(session.model.inertias)[1:]]
    return np.concatenate([*bodies, np.zeros(4 * session.model.nv)])


def answer(session, out):
    n, nominal = session.model.nv, model_of(session)
    x, y = rows_of(session, session.runs())
    y = y - x @ nominal
    noise = np.std(y, axis=0) + 1e-9
    both = np.concatenate([x, y[:, :, None]], axis=2) / noise[:, None]
    pieces = [part.reshape(-1, part.shape[2]) for part in np.array_split(both, FOLDS)]
    folds = [part.T @ part for part in pieces]
    whole, groups, names = sum(folds), groups_of(n), []

    def places(some):
        return np.concatenate([np.arange(13 * n, 14 * n), *(groups[name] for name in some)]).astype(int)

    def held_out(some):
        chosen = places(some)
        return np.array([left(fold, chosen, solve(whole - fold, chosen)) for fold in folds])

    best = held_out(names)
    while len(names) < len(groups):
        trials = {name: held_out([*names, name]) for name in groups if name not in names}
        first = min(trials, key=lambda name: trials[name].sum())
        fall = best - trials[first]
        if fall.mean() < ERRORS * fall.std(ddof=1) / np.sqrt(FOLDS) or fall.mean() <= 0.0:
            break
        names, best = [*names, first], trials[first]
    links = [int(name.split()[1]) for name in names if name[:4] == "link"]
    named = {("link_inertial_error", session.joints[j]): SURE / len(links) for j in links}
    if n - 1 in links:  # what hangs on the last link is a payload
        named = {("payload", ""): SURE}
    write_answer(session, out, named, 0.0 if named else SURE)
    if session.unseen.is_file():
        # Its edit: what is named of links is taken out, nothing is fitted again; nor is anything beside an arm before.
        change = np.zeros(14 * n)
        if session.before is None:
            change[places(names)] = solve(whole, places(names))
        change[: 10 * n] = 0.0
        time, *motion, _ = states(*session.motion())
        write_torque(session, out, time, columns(session.model, *motion) @ (nominal + change))


if __name__ == "__main__":
    enter(answer)
