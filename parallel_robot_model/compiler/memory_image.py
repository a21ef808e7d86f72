"""A boxed tuple with all that it reaches, as bytes that can be laid down elsewhere."""

from __future__ import annotations

import ctypes
from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np
from numba import typeof, types

from parallel_robot_model.compiler.boxed import ALIGNMENT, Boxed, FirstClass
from parallel_robot_model.compiler.memory import KeptValue, Space
from parallel_robot_model.compiler.numba_parts import cpu_target
from parallel_robot_model.compiler.vectors import VectorType

POINTER = 8  # bytes
DATA = 4  # field of an array in which its address lies
CODE = 2  # word of a FirstClass that kernels call without Python


class Leaf(NamedTuple):
    """A value that is no tuple, in memory.

    Attributes:
        address: Where it lies.
        kind: Its type.
        value: Itself.
    """

    address: int
    kind: Any
    value: Any


class Image(NamedTuple):
    """Memory as bytes; what lies in it is told by the number of bytes before it.

    Attributes:
        content: The bytes; where an address belongs, they are zero.
        root: Where the boxed tuple lies.
        pointers: Where an address lies, and what lies at that address.
        code: Where the address of a kernel lies, and the kernel.
        blocks: Address, size and place of each piece of the memory that was copied.
    """

    content: bytes
    root: int
    pointers: tuple[tuple[int, int], ...]
    code: tuple[tuple[int, FirstClass], ...]
    blocks: tuple[tuple[int, int, int], ...]

    def place_of(self, address: int) -> int:
        """Where in the image lies what was at an address."""
        return _placed(self.blocks, address)


def image_of(root: Boxed) -> Image:
    """Copy a boxed tuple, with the tuples, spaces, arrays and kept values that it reaches.

    Texts are left out: kernels find empty ones.
    """
    extents: dict[int, int] = {}  # size by address
    links: list[tuple[int, int]] = []
    cleared: list[tuple[int, int]] = []
    code: list[tuple[int, FirstClass]] = []
    todo = [root]
    while todo:
        boxed = todo.pop()
        if boxed.address in extents:
            continue
        whole = typeof(boxed.value)
        extents[boxed.address] = _size(whole)
        for address, kind, value in leaves(boxed.value, whole, boxed.address):
            if isinstance(value, Boxed):
                todo.append(value)
                links.append((address, value.address))
            elif isinstance(value, FirstClass):
                cleared.append((address, _size(kind)))
                code += [(address, value), (address + CODE * POINTER, value)]
            elif isinstance(value, np.ndarray) and not isinstance(kind, VectorType):
                links.append((address + DATA * POINTER, value.ctypes.data))
                extents[value.ctypes.data] = max(
                    value.nbytes, extents.get(value.ctypes.data, POINTER)
                )
            elif isinstance(value, KeptValue):
                links.append((address, int(value)))
                extents[int(value)] = value.size
            elif isinstance(value, Space):
                links.append((address, int(value)))
                extents[int(value)] = max(value.floats.nbytes, extents.get(int(value), POINTER))
            elif isinstance(value, str):
                cleared.append((address, _size(kind)))
    blocks = _laid_out(extents)
    content = bytearray(sum(blocks[-1][1:]))
    for address, size, place in blocks:
        content[place : place + size] = ctypes.string_at(address, size)
    for address, size in [*cleared, *((address, POINTER) for address, _ in links)]:
        place = _placed(blocks, address)
        content[place : place + size] = bytes(size)
    return Image(
        bytes(content),
        _placed(blocks, root.address),
        tuple((_placed(blocks, at), _placed(blocks, to)) for at, to in links),
        tuple((_placed(blocks, at), kernel) for at, kernel in code),
        tuple(blocks),
    )


def leaves(value: Any, kind: Any, address: int) -> Iterator[Leaf]:
    """What a value of a type is made of, in the order of its fields.

    Args:
        value: The value.
        kind: Its type.
        address: Where it lies.
    """
    if isinstance(kind, types.BaseTuple):
        parts, kinds = value, list(kind.types)
    elif isinstance(kind, VectorType):
        parts, kinds = value, [kind.element] * kind.count
    else:
        yield Leaf(address, kind, value)
        return
    for k, (part, inner) in enumerate(zip(parts, kinds, strict=True)):
        yield from leaves(part, inner, address + _offset(kind, k))


def _size(kind: Any) -> int:
    context = cpu_target.target_context
    return int(context.get_abi_sizeof(context.get_value_type(kind)))


def _offset(kind: Any, k: int) -> int:
    """Bytes before field `k` of a type."""
    context = cpu_target.target_context
    whole = context.get_value_type(kind)
    if hasattr(whole, 'count'):  # all of one type
        return k * int(context.get_abi_sizeof(whole.element))
    return int(whole.get_element_offset(context.target_data, k))


def _laid_out(extents: dict[int, int]) -> list[tuple[int, int, int]]:
    """Address, size and place of pieces; those that overlap are one."""
    order = {address: k for k, address in enumerate(extents)}
    pieces: list[list[int]] = []
    for address, size in sorted(extents.items()):
        if pieces and address < sum(pieces[-1][1:]):
            pieces[-1][0] = min(pieces[-1][0], order[address])
            pieces[-1][2] = max(pieces[-1][2], address + size - pieces[-1][1])
        else:
            pieces.append([order[address], address, size])
    blocks, end = [], 0
    for _, address, size in sorted(pieces):  # not by address, which is another one each time
        place = -(-end // ALIGNMENT) * ALIGNMENT
        blocks.append((address, size, place))
        end = place + size
    return blocks


def _placed(blocks: Any, address: int) -> int:
    for begin, size, place in blocks:
        if begin <= address < begin + size:
            return int(place + address - begin)
    raise ValueError(f'nothing of the image lies at {address:#x}')
