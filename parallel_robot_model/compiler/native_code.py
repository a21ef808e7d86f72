"""Kernels with their memory as an object file that needs no Python, for any x86-64 Linux."""

from __future__ import annotations

import ctypes
import re
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from typing import Any, NamedTuple, cast

import llvmlite.binding as llvm
import numpy as np
from llvmlite import ir
from numba import typeof, types

from parallel_robot_model.common.errors import InputError
from parallel_robot_model.compiler.boxed import ALIGNMENT, Boxed, FunctionValue
from parallel_robot_model.compiler.kernels import need_compiler
from parallel_robot_model.compiler.memory import FloatBuffer
from parallel_robot_model.compiler.numba_parts import bitcode_of, cpu_target
from parallel_robot_model.compiler.vectors import VectorType

# A boxed tuple with all that it reaches, as bytes that can be laid down elsewhere.

POINTER = 8  # bytes
DATA = 4  # field of an array in which its address lies
CODE = 2  # word of a FunctionValue that kernels call without Python


class Leaf(NamedTuple):
    """A value that is no tuple, in memory."""

    address: int  # where it lies
    kind: Any  # its type
    value: Any  # itself


class Image(NamedTuple):
    """Memory as bytes; what lies in it is told by the number of bytes before it."""

    content: bytes  # the bytes; where an address belongs, they are zero
    root: int  # where the boxed tuple lies
    pointers: tuple[tuple[int, int], ...]  # where an address lies, and what lies at that address
    code: tuple[
        tuple[int, FunctionValue], ...
    ]  # where the address of a kernel lies, and the kernel
    # address, size and place of each piece of the memory that was copied
    blocks: tuple[tuple[int, int, int], ...]

    def place_of(self, address: int) -> int:
        """Where in the image lies what was at an address."""
        return _parameters_at(self.blocks, address)


def image_of(root: Boxed) -> Image:
    """Copy a boxed tuple, with the tuples, spaces and arrays that it reaches.

    Texts are left out: kernels find empty ones. What is empty has no address.
    """
    extents: dict[int, int] = {}  # size by address
    links: list[tuple[int, int]] = []
    cleared: list[tuple[int, int]] = []
    code: list[tuple[int, FunctionValue]] = []
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
            elif isinstance(value, FunctionValue):
                cleared.append((address, _size(kind)))
                code += [(address, value), (address + CODE * POINTER, value)]
            elif isinstance(value, np.ndarray) and not isinstance(kind, VectorType):
                links.append((address + DATA * POINTER, value.ctypes.data))
                extents[value.ctypes.data] = max(value.nbytes, extents.get(value.ctypes.data, 0))
            elif isinstance(value, FloatBuffer):
                links.append((address, int(value)))
                extents[int(value)] = max(value.floats.nbytes, extents.get(int(value), 0))
            elif isinstance(value, str):
                cleared.append((address, _size(kind)))
    blocks = _laid_out({address: size for address, size in extents.items() if size})
    content = bytearray(sum(blocks[-1][1:]))
    for address, size, place in blocks:
        content[place : place + size] = ctypes.string_at(address, size)
    for address, size in [*cleared, *((address, POINTER) for address, _ in links)]:
        place = _parameters_at(blocks, address)
        content[place : place + size] = bytes(size)
    return Image(
        bytes(content),
        _parameters_at(blocks, root.address),
        tuple(
            (_parameters_at(blocks, at), _parameters_at(blocks, to))
            for at, to in links
            if extents[to]
        ),
        tuple((_parameters_at(blocks, at), kernel) for at, kernel in code),
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


def _parameters_at(blocks: Any, address: int) -> int:
    for begin, size, place in blocks:
        if begin <= address < begin + size:
            return int(place + address - begin)
    raise ValueError(f'nothing of the image lies at {address:#x}')


TRIPLE, PROCESSOR = 'x86_64-unknown-linux-gnu', 'x86-64'
FOREIGN = ('Py', '_Py', 'numba_', 'NRT_')  # begin of names that Python or its run time has
MAKES_ARRAYS = ('NRT_Allocate', 'NRT_MemInfo_alloc')  # begin of those that take memory

_BYTE, _WORD, _STATUS = ir.IntType(8), ir.IntType(64), ir.IntType(32)
_ADDRESS = _BYTE.as_pointer()


class NativeObject(NamedTuple):
    """An object file with functions ``int NAME(void *root)``, and with ``image_*``.

    The tables are those of an :class:`Image`: ``image_content``, ``image_size``, ``image_root``;
    ``image_pointers`` of ``image_pointer_count`` pairs; ``image_code_places`` and ``image_code``
    of ``image_code_count``. A function returns what its kernel does, or a number below 0 if it
    raised.
    """

    content: bytes  # the file, ELF
    image: Image  # the memory


def native_object(entries: Mapping[str, Callable[..., int]], root: Boxed) -> NativeObject:
    """Compile kernels of a boxed tuple, with all that they call.

    The code is the one that runs in this process, instruction by instruction of LLVM, for the
    least processor: no product and sum are contracted, so results are the same to the last bit.

    Args:
        entries: Kernels that take the tuple and return a whole number, by their names.
        root: The tuple.

    Raises:
        InputError: a kernel makes arrays.
    """
    need_compiler()
    image = image_of(root)
    names: dict[Any, str] = {}  # of entries by their name, of others by themselves
    parts: dict[str, bytes] = {}
    for name, function in entries.items():
        kernel = cast(Any, function)
        kernel.compile((typeof(root),))
        mangled, part = bitcode_of(kernel.overloads[(typeof(root),)])
        names[name], parts[mangled] = mangled, part
    kernels = list({id(value): value for _, value in image.code}.values())
    for value in kernels:
        mangled, part = bitcode_of(value.compiled)
        names[value], parts[mangled] = mangled, part
    whole = llvm.parse_assembly(_frame(image, names))
    for part in parts.values():
        whole.link_in(llvm.parse_bitcode(part))
    return NativeObject(_emitted(whole, entries), image)


def _frame(image: Image, names: Mapping[Any, str]) -> str:
    """The functions that others call, and the image, as LLVM's text."""
    module = ir.Module()
    module.triple = TRIPLE
    kind = ir.FunctionType(_STATUS, [_WORD.as_pointer(), _ADDRESS.as_pointer(), _ADDRESS])
    declared = {name: ir.Function(module, kind, name) for name in dict.fromkeys(names.values())}
    for key, name in names.items():
        if isinstance(key, str):
            entry = ir.Function(module, ir.FunctionType(_STATUS, [_ADDRESS]), key)
            builder = ir.IRBuilder(entry.append_basic_block())
            result, reason = builder.alloca(_WORD), builder.alloca(_ADDRESS)
            status = builder.call(declared[name], [result, reason, entry.args[0]])
            well = builder.icmp_signed('==', status, _STATUS(0))
            number = builder.trunc(builder.load(result), _STATUS)
            builder.ret(builder.select(well, number, status))
    _constant(module, 'image_content', ir.ArrayType(_BYTE, len(image.content)), image.content)
    for name, number in (
        ('image_size', len(image.content)),
        ('image_root', image.root),
        ('image_pointer_count', len(image.pointers)),
        ('image_code_count', len(image.code)),
    ):
        _constant(module, name, _WORD, number)
    pair, count = ir.ArrayType(_WORD, 2), len(image.pointers)
    rows = [ir.Constant(pair, list(row)) for row in image.pointers]
    _constant(module, 'image_pointers', ir.ArrayType(pair, count), rows)
    places = [ir.Constant(_WORD, place) for place, _ in image.code]
    code = [declared[names[value]].bitcast(_ADDRESS) for _, value in image.code]
    _constant(module, 'image_code_places', ir.ArrayType(_WORD, len(places)), places)
    _constant(module, 'image_code', ir.ArrayType(_ADDRESS, len(code)), code)
    return str(module)


def _constant(module: ir.Module, name: str, kind: Any, value: Any) -> None:
    variable = ir.GlobalVariable(module, kind, name)
    variable.global_constant = True
    data = bytearray(value) if isinstance(value, bytes) else value
    variable.initializer = ir.Constant(kind, data)


def _emitted(module: Any, entries: Collection[str]) -> bytes:
    """The machine code of a module without what nobody calls."""
    llvm.initialize_all_targets()
    llvm.initialize_all_asmprinters()
    machine = llvm.Target.from_triple(TRIPLE).create_target_machine(
        PROCESSOR, opt=3, reloc='pic', codemodel='default'
    )
    _keep_alone(module, entries, machine)
    foreign = [each for each in module.functions if each.is_declaration and _is_foreign(each)]
    if any(each.name.startswith(MAKES_ARRAYS) for each in foreign):
        raise InputError(
            'native code cannot make arrays; let the kernels compute with vectors, '
            'see "Vectors" in docs/robots.md'
        )
    module.link_in(llvm.parse_assembly(_refusals(foreign)))
    _keep_alone(module, entries, machine)
    return bytes(machine.emit_object(module))


def _keep_alone(module: Any, entries: Collection[str], machine: Any) -> None:
    """Leave out of a module what its entries do not need."""
    for each in (*module.functions, *module.global_variables):
        shown = each.name in entries or each.name.startswith('image_')
        if not each.is_declaration and not shown:
            each.linkage = 'internal'
    builder = llvm.create_pass_builder(machine, llvm.create_pipeline_tuning_options())
    passes = llvm.create_new_module_pass_manager()
    passes.add_global_dead_code_eliminate_pass()
    passes.add_strip_dead_prototype_pass()
    passes.run(module, builder)


def _is_foreign(function: Any) -> bool:
    return str(function.name).startswith(FOREIGN)


def _refusals(foreign: Iterable[Any]) -> str:
    """Definitions of functions of Python, as LLVM's text: they end the process.

    They are behind branches that are not taken: for a FunctionValue without machine code, and for
    the count of references to an array's memory, which no array of an image has.
    """
    lines = ['declare void @abort()']
    for function in foreign:
        head = re.sub(r'\)[^)]*$', ')', str(function).strip().replace('declare', 'define', 1))
        lines.append(f'{head} {{\n  call void @abort()\n  unreachable\n}}')
    return '\n'.join(lines)
