"""MuJoCo's compiler: MJCF made a model without files."""

from __future__ import annotations

import contextlib
import math
import re
import warnings
from collections.abc import Iterator
from typing import Any

from parallel_robot_model.common.errors import InputError, optional, printable


def specified(text: str, source: str, merged: bool) -> Any:
    """The specification of a model, with no shapes but those that inertias need.

    Args:
        text: MJCF that was prepared by `mjcf_text`.
        source: What the file is called in messages.
        merged: Whether its lines are those of no file.

    Raises:
        InputError: MuJoCo is not installed, does not take the text, or needs a mesh.
    """
    mujoco = optional('mujoco')
    with _naming(source, merged):
        spec = mujoco.MjSpec.from_string(text)
        for body in spec.bodies:
            _need_no_meshes(mujoco, spec, body, source)
    return spec


def compiled(spec: Any, source: str, merged: bool) -> Any:
    """The model of a specification.

    Raises:
        InputError: MuJoCo does not take it.
    """
    with _naming(source, merged):
        return spec.compile()


@contextlib.contextmanager
def _naming(source: str, merged: bool) -> Iterator[None]:
    """What MuJoCo refuses, with the name of the file."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter('ignore')  # of states and of contacts
            yield
    except (ValueError, optional('mujoco').FatalError) as error:
        raise InputError(f'{source}: {_reason(str(error), merged)}') from None


def _need_no_meshes(mujoco: Any, spec: Any, body: Any, source: str) -> None:
    """Refuse a body whose inertia is that of a mesh; make other meshes points without mass."""
    kinds = mujoco.mjtGeom
    meshes = kinds.mjGEOM_MESH, kinds.mjGEOM_HFIELD, kinds.mjGEOM_SDF
    lowest, highest = spec.compiler.inertiagrouprange
    from_geoms = spec.compiler.inertiafromgeom == mujoco.mjtInertiaFromGeom.mjINERTIAFROMGEOM_TRUE
    known = body.explicitinertial and not from_geoms
    for geom in body.geoms:
        if geom.type not in meshes and not geom.meshname:
            continue
        counts = lowest <= geom.group <= highest and geom.mass != 0 and geom.density != 0
        if counts and not known and _moves(body):
            raise InputError(
                f'{source}: body {printable(body.name)!r} has no inertial, and that of its mesh '
                f'{printable(geom.meshname)!r} is not known: add one'
            )
        geom.type, geom.meshname, geom.hfieldname = kinds.mjGEOM_SPHERE, '', ''
        geom.size, geom.mass, geom.fromto = [1e-3, 0, 0], 0.0, [math.nan] * 6


def _moves(body: Any) -> bool:
    """Whether a body, or one that carries it, has a joint."""
    while body.name != 'world':
        if len(body.joints):
            return True
        body = body.parent
    return False


def _reason(text: str, merged: bool) -> str:
    """What MuJoCo says, on one line."""
    text = re.sub(r'(XML )?Error: *', '', ' '.join(text.split()))
    return printable(re.sub(r',? line \d+', '', text) if merged else text)
