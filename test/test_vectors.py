"""Vectors against the scalar kernel, element by element, to the bit."""

import functools
import math
import operator
import sys
from typing import NamedTuple

import numba
import numpy as np
import pytest
from numba.core.errors import NumbaError

from parallel_robot_model.compiler import (
    Vector,
    as_arrays,
    as_vectors,
    clip,
    cross,
    dot,
    entry_point,
    every,
    kernel,
    largest,
    multiply,
    read_row,
    select,
    solve,
    some,
    vector,
    write_row,
)
from parallel_robot_model.compiler.vectors import BINARY, UNARY

ODD = [0.0, -0.0, math.nan, math.inf, -math.inf, 1.0, -1.0, 5e-324, 1e308, 0.5, -2.5, 3.0]
X = np.array([*ODD, *(3.0 * np.random.default_rng(1).standard_normal(52))])
Y = np.roll(X, 7)
SIZE = 8
SYMBOLS = {
    operator.add: '+', operator.sub: '-', operator.mul: '*', operator.truediv: '/',
    operator.pow: '**', operator.lt: '<', operator.le: '<=', operator.gt: '>', operator.ge: '>=',
    operator.eq: '==', operator.ne: '!=', operator.and_: '&', operator.or_: '|',
}  # fmt: skip


def compiled(text, **names):
    """A function of one line as a kernel that is not kept on disk."""
    return numba.njit(eval(text, names), error_model='numpy')


def run(function, *arguments):
    """Call a kernel with exactly these types."""
    return entry_point(function, *arguments)(*arguments)


def name_of(function):
    return f'{getattr(function, "__module__", "")}.{function.__name__}'


ARGUMENTS = {1: 'a', 2: 'a, b'}
LOGIC, WHOLE = {operator.and_, operator.or_}, {math.floor}  # functions of other operands


def text_of(function, name, count):
    """A call of a function as it is written."""
    if function is operator.neg:
        return '-a'
    symbol = SYMBOLS.get(function)
    return f'a {symbol} b' if symbol else f'{name}({ARGUMENTS[count]})'


@functools.cache
def together(functions, count):
    """A kernel with the values of many functions, which takes less time than one for each."""
    names = {f'f{k}': function for k, function in enumerate(functions)}
    texts = [text_of(function, name, count) for name, function in names.items()]
    return compiled(f'lambda {ARGUMENTS[count]}: ({", ".join(texts)},)', **names)


def called(function, functions, count):
    """A function of one or two arguments, in a kernel with those that take the same operands."""
    kind = next(
        (kind for kind in (LOGIC, WHOLE) if function in kind), {*functions} - LOGIC - WHOLE
    )
    group = tuple(other for other in functions if other in kind)
    whole, k = together(group, count), group.index(function)
    return lambda *arguments: run(whole, *arguments)[k]


def unary(function):
    return called(function, UNARY, 1)


def binary(function):
    return called(function, BINARY, 2)


def operands(function):
    """Numbers for a function: floats, or truth values for logic; a floor is an integer."""
    if function in LOGIC:
        return X > 0.0, Y > 0.0
    if function in WHOLE:
        return X[12:44], Y[12:44]
    return X, Y


def one_by_one(function, *arguments):
    return np.array([function(*(x.item() for x in row)) for row in np.broadcast(*arguments)])


def rows(x, shape):
    """An array as many vectors of a shape, one after the other."""
    return [row.copy().view(Vector) for row in x.reshape(-1, *shape)]


def same(found, expected):
    """Whether all bits are the same; one NaN is as good as another."""
    found, expected = np.ravel(found), np.ravel(expected)
    if found.dtype != np.float64 or expected.dtype != np.float64:
        return np.array_equal(found, expected)
    nan = np.isnan(expected)
    bits = found.view(np.int64) == expected.view(np.int64)
    return np.array_equal(np.isnan(found), nan) and bool(bits[~nan].all())


forms = pytest.mark.parametrize('shape', [(SIZE,), (SIZE // 4, 4)], ids=['vector', 'matrix'])


@forms
@pytest.mark.parametrize('function', UNARY, ids=name_of)
def test_functions_of_one_argument(function, shape):
    f, (x, _) = unary(function), operands(function)
    found = [f(row) for row in rows(x, shape)]
    assert all(type(row) is Vector for row in found)
    assert same(found, one_by_one(f, x))


@forms
@pytest.mark.parametrize('function', BINARY, ids=name_of)
def test_functions_of_two_arguments(function, shape):
    f, (x, y) = binary(function), operands(function)
    pairs = zip(rows(x, shape), rows(y, shape), strict=True)
    found = [f(*pair) for pair in pairs]
    assert all(type(row) is Vector for row in found)
    assert same(found, one_by_one(f, x, y))


@forms
@pytest.mark.parametrize('function', BINARY, ids=name_of)
def test_a_scalar_counts_for_all_elements(function, shape):
    f, (x, _) = binary(function), operands(function)
    (row, *_), one = rows(x, shape), x[-1].item()
    numbers = np.ravel(row)
    assert same(f(row, one), one_by_one(f, numbers, one))
    assert same(f(one, row), one_by_one(f, one, numbers))


@pytest.mark.parametrize('power', [2, 3, -1, 0.5])
@forms
def test_a_constant_power_is_that_of_a_scalar(power, shape):
    f = compiled(f'lambda a: a ** {power}')
    x = X[12:44] if power == -1 else X  # a vector with a zero would raise ZeroDivisionError
    found = [run(f, row) for row in rows(x, shape)]
    assert same(found, [run(f, a.item()) for a in x])


def test_integers_and_truth_values():
    f, i = compiled('lambda a, b: a + b'), np.array([3, -1, 0, 7]).view(Vector)
    found = run(f, i, i)
    assert found.dtype == np.int64 and same(found, 2 * i)
    found = run(f, i, 5)
    assert found.dtype == np.int64 and same(found, i + 5)
    equal = compiled('lambda a, b: a == b')
    assert run(equal, i, 7).tolist() == [False, False, False, True]
    assert same(run(f, i, 0.5), i + 0.5)
    truth = np.array([True, False, True, True])
    assert run(equal, truth.view(Vector), False).tolist() == (~truth).tolist()


@pytest.mark.parametrize('text', ['a + b', 'a < b', 'a @ b', 'select(a < 0.0, a, b)', 'f(a, b)'])
def test_vectors_of_different_sizes_do_not_go_together(text):
    f = compiled(f'lambda a, b: {text}', select=select, f=math.atan2)
    with pytest.raises(NumbaError):
        run(f, vector([1.0, 2.0, 3.0]), vector([1.0, 2.0]))


@pytest.mark.parametrize('text', ['a + b', 'b * a', 'a < b', 'select(a < 0.0, a, b)'])
def test_vectors_and_arrays_do_not_go_together(text):
    with pytest.raises(NumbaError):
        run(compiled(f'lambda a, b: {text}', select=select), vector([1.0, 2.0]), np.zeros(2))


def test_an_index_counts_from_both_ends_and_reads_nothing_beyond_them():
    x, M = vector(X[12:15]), vector(X[12:21].reshape(3, 3))
    at, constant = compiled('lambda x, i: x[i]'), compiled('lambda x: (x[0], x[-1], x[2])')
    assert [run(at, x, i) for i in range(-3, 3)] == [*X[12:15], *X[12:15]]
    assert [run(at, x, i) for i in (3, -4, 3 * 10**6 + 1)] == [X[12], X[14], X[13]]
    assert run(constant, x) == (X[12], X[14], X[14])
    assert run(at, M, 1).tolist() == M[1].tolist() and type(run(at, M, 1)) is Vector
    assert run(compiled('lambda m, i: (m[i, 2], m[-1, 0])'), M, 1) == (M[1, 2], M[2, 0])
    with pytest.raises(NumbaError):
        run(compiled('lambda x: x[0:2]'), x)
    with pytest.raises(NumbaError):
        run(at, x, 1.0)


def test_sizes_and_loops():
    total = compiled('lambda x: (len(x), sum([x[i] for i in range(len(x))]))')
    assert run(total, vector([1.0, 2.0, 4.0])) == (3, 7.0)
    assert run(compiled('lambda m: len(m)'), vector(np.eye(2))) == 2


def test_functions_of_whole_vectors():
    x = X[12:15]
    row = x.copy().view(Vector)
    for shift in (1, -1, 2, 5):
        found = run(compiled(f'lambda x: np.roll(x, {shift})', np=np), row)
        assert type(found) is Vector and same(found, np.roll(x, shift))
    assert same(run(compiled('lambda x: np.sum(x)', np=np), row), x[0] + x[1] + x[2])
    zeros = run(compiled('lambda x: np.zeros_like(x)', np=np), (x * np.inf).view(Vector))
    assert same(zeros, np.zeros(3))
    assert same(run(compiled('lambda x: np.diag(x)', np=np), row), np.diag(x))
    found = run(compiled('lambda a: np.transpose(a)', np=np), vector(X[:6].reshape(2, 3)))
    assert type(found) is Vector and same(found, X[:6].reshape(2, 3).T)
    assert same(run(compiled('lambda x: vector(x)', vector=vector), row), x)


def test_a_product_is_summed_in_order():
    a, x = X[20:36].reshape(4, 4), X[40:44]
    expected = [((a[i, 0] * x[0] + a[i, 1] * x[1]) + a[i, 2] * x[2]) + a[i, 3] * x[3]
                for i in range(4)]  # fmt: skip
    product = compiled('lambda a, x: a @ x')
    assert same(run(product, vector(a), vector(x)), expected)
    assert same(multiply(vector(a), vector(x)), expected) and same(multiply(a, x), expected)


def test_vectors_are_made_of_tuples():
    make, pair = compiled('lambda t: v(t)', v=vector), compiled('lambda a, b: v((a, b))', v=vector)
    assert run(make, (1.0, 2, True)).tolist() == [1.0, 2.0, 1.0]
    assert run(make, (1, 2)).dtype == np.float64 and run(make, ()).shape == (0,)
    matrix = run(pair, vector([1.0, 2.0]), vector([3.0, 4.0]))
    assert type(matrix) is Vector and matrix.tolist() == [[1.0, 2.0], [3.0, 4.0]]
    with pytest.raises(NumbaError):
        run(pair, vector([1.0, 2.0]), vector([3.0]))


class Pair(NamedTuple):
    """A tuple with names."""

    position: object
    fault: object


def test_select_takes_one_of_two():
    choose = compiled('lambda c, a, b: select(c, a, b)', select=select)
    c, a, b = X[12:16] > 0.0, X[16:20], X[20:24]
    expected = np.where(c, a, b)
    assert run(choose, True, 1.5, 2) == 1.5 and run(choose, False, 1, 2) == 2
    assert same(run(choose, c, a, b), expected)  # arrays
    c, a, b = c.view(Vector), a.view(Vector), b.view(Vector)
    assert same(run(choose, c, a, b), expected)
    assert same(run(choose, c, a, 0.5), np.where(c, a, 0.5))
    assert same(run(choose, c, 0.5, 2), np.where(c, 0.5, 2))
    found = run(choose, c, 1, 2)
    assert found.dtype == np.int64 and same(found, np.where(c, 1, 2))
    assert same(run(choose, True, a, b), a)
    found = run(choose, False, Pair(a, 1), Pair(b, 2))
    assert type(found) is Pair and found.fault == 2 and same(found.position, b)
    for wrong in ((True, vector([1.0]), np.zeros(1)), (True, (1.0, 2.0), (1.0,)), (1.0, 2.0, 3.0)):
        with pytest.raises(NumbaError):
            run(choose, *wrong)


def test_a_choice_of_arrays_keeps_both_alive():
    """Their counts of references are those of before."""
    choose = compiled('lambda c, a, b: select(c, a, b)', select=select)
    a, b = np.ones(3), np.zeros(3)
    before = sys.getrefcount(a), sys.getrefcount(b)
    for condition in 10 * (True, False):
        found = run(choose, condition, (a, 1), (b, 2))
        assert found[0].tolist() == (a if condition else b).tolist()
        del found
    assert (sys.getrefcount(a), sys.getrefcount(b)) == before


@pytest.mark.parametrize('values', [[True] * 3, [False] * 3, [False, False, True]])
def test_every_and_some(values):
    x = np.array(values)
    both = compiled('lambda x: (every(x), some(x))', every=every, some=some)
    assert run(both, x.view(Vector)) == (all(values), any(values)) == run(both, x)


def test_clip_keeps_nan():
    x = vector([math.nan, -7.0, 7.0, 0.5, -0.0])
    assert same(clip(x, -1.0, 1.0), [math.nan, -1.0, 1.0, 0.5, -0.0])
    assert same(clip(x, vector([0.0] * 5), vector([9.0] * 5)), [math.nan, 0.0, 7.0, 0.5, -0.0])
    assert same(clip(np.array(x), -1.0, 1.0), clip(x, -1.0, 1.0))


def test_largest_is_that_of_magnitudes():
    for numbers in ([3.0, -5.0, 4.0], [-2.0], [0.0, -0.0], [1.0, math.inf]):
        assert largest(vector(numbers)) == largest(np.array(numbers)) == np.abs(numbers).max()


def test_rows_of_arrays():
    store, table = np.full((4, 3), 9.0), np.arange(12.0).reshape(4, 3)
    read = compiled('lambda a, i, like: read_row(a, i, like)', read_row=read_row)
    write = compiled('lambda a, i, x: write_row(a, i, x)', write_row=write_row)
    like = vector([0.0, 0.0, 0.0])
    assert run(read, table, 2, like).tolist() == [6.0, 7.0, 8.0]
    assert run(read, table[1], 0, like).tolist() == [3.0, 4.0, 5.0]
    run(write, store, 1, vector([1.0, 2.0, 3.0]))
    assert store.tolist() == [[9.0] * 3, [1.0, 2.0, 3.0], [9.0] * 3, [9.0] * 3]
    numbers = np.zeros(3)
    run(write, numbers, 1, 2), run(write, numbers, 2, 0.5)
    assert numbers.tolist() == [0.0, 2.0, 0.5]
    truth = np.zeros((2, 3), bool)
    run(write, truth, 1, np.array([True, False, True]).view(Vector))
    assert truth.tolist() == [[False] * 3, [True, False, True]]
    assert run(read, truth, 1, truth[0].copy().view(Vector)).tolist() == [True, False, True]


@pytest.mark.parametrize(
    'table', [np.zeros((4, 6))[:, ::2], np.zeros((3, 4)).T, np.zeros((4, 3), np.int64), 1.0]
)
def test_rows_that_are_not_vectors_are_refused(table):
    row = vector([0.0] * 3)
    with pytest.raises(NumbaError):
        run(compiled('lambda a, x: read_row(a, 0, x)', read_row=read_row), table, row)
    with pytest.raises(NumbaError):
        run(compiled('lambda a, x: write_row(a, 0, x)', write_row=write_row), table, row)


def test_an_array_that_is_read_alone_is_not_written():
    table = np.zeros((2, 3))
    table.flags.writeable = False
    write = compiled('lambda a, x: write_row(a, 0, x)', write_row=write_row)
    with pytest.raises(NumbaError):
        run(write, table, vector([1.0] * 3))


@kernel
def twice(x):
    """2 x, of anything."""
    return 2.0 * x


@kernel
def position_of(pair):
    """An element of a tuple."""
    return twice(pair.position)


def test_python_calls_a_kernel_with_vectors_of_any_size_and_with_arrays():
    """In either order: Numba itself takes them for one type."""
    for n in (3, 2, 5, 0, 1):
        x = np.arange(float(n))
        for given, kind in ((x, np.ndarray), (vector(x), Vector)):
            for found in (twice(given), position_of(Pair(given, 0))):
                assert type(found) is kind and found.tolist() == (2.0 * x).tolist()
    M = np.arange(9.0).reshape(3, 3)
    assert twice(vector(M)).tolist() == (2.0 * M).tolist()
    assert twice(vector(M[:2, :2])).tolist() == (2.0 * M[:2, :2]).tolist()


def test_what_is_not_a_contiguous_array_of_that_shape_is_refused():
    x, M = vector(np.arange(6.0)), vector(np.arange(9.0).reshape(3, 3))
    for wrong in (x[::2], x[::-1], M.T, M[:, 0], M[:, :2]):
        with pytest.raises(TypeError, match='contiguous array of shape'):
            twice(wrong)
    assert twice(x[2:4]).tolist() == [4.0, 6.0] and twice(M[1]).tolist() == [6.0, 8.0, 10.0]
    assert twice(vector(M.T)).tolist() == (2.0 * M.T).tolist()
    assert twice(vector(x[::-2])).tolist() == [10.0, 6.0, 2.0]
    assert twice(vector(M)[:1].T[:1]).tolist() == [[0.0]]
    of_three = entry_point(twice, x[:3])
    for wrong in (x, x[:2], M, None, [1.0, 2.0, 3.0], 1.0):
        with pytest.raises(TypeError):
            of_three(wrong)
    assert of_three(np.arange(3.0)).tolist() == [0.0, 2.0, 4.0]


@pytest.mark.parametrize('dtype', ['f4', '>f8', 'i4', 'u8', 'c16', 'O'])
def test_other_numbers_are_refused(dtype):
    with pytest.raises(ValueError, match='Cannot determine Numba type'):
        twice(np.zeros(3, dtype).view(Vector))


@kernel
def same_again(x):
    """What it gets."""
    return x


@pytest.mark.parametrize(
    'value',
    [
        np.array(ODD).view(Vector),
        np.array([[1.0, -0.0], [math.nan, 4.0]]).view(Vector),
        np.zeros(0).view(Vector),
        np.zeros((3, 0)).view(Vector),
        np.arange(27.0).reshape(3, 3, 3).view(Vector),
        np.array([True, False, True]).view(Vector),
        np.array([[True], [False]]).view(Vector),
        np.array([-(2**63), 2**63 - 1]).view(Vector),
    ],
    ids=lambda value: f'{type(value).__name__} {value.dtype} {value.shape}',
)
def test_a_value_comes_back_as_it_went(value):
    found = same_again(value)
    assert type(found) is type(value) and found.dtype == value.dtype
    assert found.shape == value.shape and same(found, value)
    assert found.flags.writeable and not np.shares_memory(found, value)
    inside = same_again(Pair((value, 1.5), 2))
    assert type(inside) is Pair and inside[1] == 2 and inside[0][1] == 1.5
    assert same(inside[0][0], value)


def test_a_value_does_not_change_with_the_array_it_came_from():
    x = vector([1.0, 2.0])
    found = same_again(x)
    x[0] = 9.0
    assert found.tolist() == [1.0, 2.0]


def test_vectors_of_no_elements():
    none = vector(())
    assert twice(none).shape == (0,) and len(none) == 0
    shapes = compiled('lambda x: (len(x), np.roll(x, 1), np.zeros_like(x), np.diag(x))', np=np)
    size, *rest = run(shapes, none)
    assert size == 0 and [x.shape for x in rest] == [(0,), (0,), (0, 0)]
    never = compiled('lambda x: [x[i] for i in range(len(x))] + [1.0]')
    assert run(never, none) == [1.0]
    assert run(compiled('lambda x: x[0]'), none) == 0.0  # nothing is read


def test_tuples_of_arrays_and_of_vectors():
    given = Pair((np.zeros(2), np.arange(2), 'text', None), np.eye(2))
    found = as_vectors(given)
    assert type(found) is Pair and type(found.fault) is type(found.position[0]) is Vector
    assert type(found.position[1]) is Vector and found.position[1].dtype == np.int64
    assert found.position[2:] == given.position[2:]
    back = as_arrays(found)
    assert type(back) is Pair and type(back.fault) is type(back.position[0]) is np.ndarray
    assert back.fault.tolist() == np.eye(2).tolist()
    assert not np.shares_memory(back.fault, found.fault)


def test_small_matrices_as_the_documentation_has_them():
    """Product, transpose, inverse of a symmetric matrix: by NumPy, too."""

    def all_three(a, b, m):
        turned = vector((vector((a[0, 0], a[1, 0])), vector((a[0, 1], a[1, 1]))))
        inverse = vector((solve(m, vector((1.0, 0.0))), solve(m, vector((0.0, 1.0)))))
        return a @ b, turned @ b, inverse, dot(a[0], b[1])

    a, b = np.array([[1.0, 2.0], [3.0, 5.0]]), np.array([[0.5, -1.0], [4.0, 2.0]])
    m = a @ a.T
    found = run(numba.njit(all_three), *map(vector, (a, b, m)))
    wanted = a @ b, a.T @ b, np.linalg.inv(m), a[0] @ b[1]
    for one, right in zip(found, wanted, strict=True):
        assert np.allclose(one, right, rtol=1e-12)


LANES = {  # of x and y, shape (3,), and a symmetric matrix m
    'elements': 'x * y + 0.5 * np.sin(x) - 2.0',
    'cross': 'cross(x, y)',
    'dot': 'dot(x, y)',
    'product': 'm @ (np.transpose(m) @ x)',
    'solve': 'solve(m, x)',
    'select': 'select(x > y, x, clip(y, -0.1, 0.1))',
    'vector': 'vector((0.0, x[2] * y[0], 1.0))',
    'matrix': 'np.diag(x) @ np.roll(y, 1) + np.zeros_like(x)',
}


@pytest.mark.parametrize('text', LANES.values(), ids=LANES)
def test_what_is_computed_for_one_robot_is_computed_for_eight_at_once(text):
    """The element of a vector is a parameter of its type: a number, or one of each robot."""
    names = {'np': np, 'cross': cross, 'dot': dot, 'solve': solve, 'vector': vector}
    made = compiled(f'lambda x, y, m: {text}', select=select, clip=clip, **names)
    random = np.random.default_rng(3)
    x, y, m = (random.normal(size=(*shape, SIZE)) for shape in ((3,), (3,), (3, 3)))
    m = np.einsum('ijk,ljk->ilk', m, m) + np.eye(3)[:, :, np.newaxis]
    eight = np.asarray(run(made, *as_vectors((x, y, m))))
    for k in range(SIZE):
        one = np.asarray(run(made, *as_vectors((x[..., k], y[..., k], m[..., k]))))
        np.testing.assert_array_equal(eight[..., k], one)
