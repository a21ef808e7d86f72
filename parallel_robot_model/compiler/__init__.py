"""The compiler: what kernels are made of. Its submodules are nobody else's business.

Laws and robots
    ``kernel`` compiles a function; ``internal`` one that only kernels call, ``inline_ir`` one that
    becomes a part of its caller. ``vector`` makes a vector, a value of a fixed size that kernels
    compute with as with a number; ``select``, ``every``, ``some``, ``is_finite`` and ``clip``
    decide by element, ``largest`` is the magnitude of one, ``dot``, ``cross``, ``multiply`` and
    ``solve`` are linear algebra.
Loops
    ``read_row`` and ``write_row`` reach the rows of arrays, ``read_at`` and ``write_at`` memory by
    its address, a ``FloatBuffer``; ``send``, ``poll``, ``recv`` and ``shutdown`` are those of
    libc. ``FunctionValue`` makes a kernel a value that other kernels take,
    ``specialize`` one that has others inside; ``Boxed`` makes a tuple a constant that they take by
    its address, of type ``OPAQUE`` where only that is needed; ``as_constants`` is how they read
    parameters; ``entry_point`` makes a kernel one that is called from Python without a look at its
    types. A ``Struct`` is memory whose fields kernels and Python read and write by their names,
    ``zeros_of`` what is in one at first.
    ``arrays_of`` and ``vectors_of`` turn vectors to arrays and back.
Out of Python
    ``native_object`` makes an object file of kernels and of the boxed tuple that they take, with
    an ``Image`` of its memory; ``leaves`` are the numbers in a tuple, and where they lie.
Python
    ``sine``, ``cosine``, ``arctangent``, ``solve_full`` and ``solve_sparse`` are for numbers that
    reach a bag: numpy and scipy choose their code by the processor.
"""

from parallel_robot_model.compiler.boxed import (
    OPAQUE,
    Boxed,
    FunctionValue,
    Struct,
    as_constants,
    plain_type,
    zeros_of,
)
from parallel_robot_model.compiler.elementary.names import arctangent, cosine, sine
from parallel_robot_model.compiler.kernels import (
    entry_point,
    inline_ir,
    internal,
    kernel,
    need_compiler,
    reason,
    specialize,
)
from parallel_robot_model.compiler.linear_algebra import (
    cross,
    dot,
    multiply,
    solve,
    solve_full,
    solve_sparse,
)
from parallel_robot_model.compiler.memory import (
    FloatBuffer,
    poll,
    read_at,
    recv,
    send,
    shutdown,
    write_at,
)
from parallel_robot_model.compiler.native_code import (
    Image,
    Leaf,
    NativeObject,
    leaves,
    native_object,
)
from parallel_robot_model.compiler.vector_kernels import (
    arrays_of,
    clip,
    every,
    is_finite,
    largest,
    read_row,
    select,
    some,
    vectors_of,
    write_row,
)
from parallel_robot_model.compiler.vectors import (
    INTERPRETED,
    Vector,
    VectorType,
    as_arrays,
    as_vectors,
    shape_of,
    vector,
)

__all__ = [
    'INTERPRETED',
    'OPAQUE',
    'Boxed',
    'FloatBuffer',
    'FunctionValue',
    'Image',
    'Leaf',
    'NativeObject',
    'Struct',
    'Vector',
    'VectorType',
    'arctangent',
    'arrays_of',
    'as_arrays',
    'as_constants',
    'as_vectors',
    'clip',
    'cosine',
    'cross',
    'dot',
    'entry_point',
    'every',
    'inline_ir',
    'internal',
    'is_finite',
    'kernel',
    'largest',
    'leaves',
    'multiply',
    'native_object',
    'need_compiler',
    'plain_type',
    'poll',
    'read_at',
    'read_row',
    'reason',
    'recv',
    'select',
    'send',
    'shape_of',
    'shutdown',
    'sine',
    'solve',
    'solve_full',
    'solve_sparse',
    'some',
    'specialize',
    'vector',
    'vectors_of',
    'write_at',
    'write_row',
    'zeros_of',
]  # fmt: skip
