"""What is wrong with the joint states that a controller hears, in lines for its user."""

from __future__ import annotations

from parallel_robot_model.common.units import NANOSECONDS

AHEAD = NANOSECONDS // 1000  # ns, by which clocks that are synchronised may differ
SYNCHRONISE = 'synchronise the clocks (PTP, chrony)'


def of_clock(ahead: int) -> str:
    """That stamps lie ahead of the clock by some time [ns]; empty if they do not."""
    if ahead <= AHEAD:
        return ''
    seconds = ahead / NANOSECONDS
    return f'joint states are stamped {seconds:.3g} s ahead: cannot be latency; {SYNCHRONISE}'


def of_age(age: int, limit: float) -> str:
    """That states are refused because they are too old.

    Args:
        age: How old they are when they come [ns].
        limit: How old they may be [s].
    """
    return (
        f'joint states are {age / NANOSECONDS:.3g} s old when they come and refused '
        f'(safety.state_age {limit:g} s): {SYNCHRONISE}, or find what holds them up'
    )


def of_numbers(problem: str, joints: tuple[str, ...]) -> str:
    """That states are refused because numbers are missing.

    Args:
        problem: What is wrong with them, see JointReader.
        joints: Names of the joints.
    """
    what = f'joint states are refused: {problem}'
    if problem.startswith('velocity'):
        way = 'estimator.kind filter or levant, or kalman with estimator.velocities false'
        return f'{what}; {way}, needs positions alone'
    return f'{what}; wanted are those of {", ".join(joints)}'
