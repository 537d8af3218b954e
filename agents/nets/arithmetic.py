"""Arithmetic whose bits are the same on every processor, in compiled code.

IEEE 754 fixes how sums, products, quotients and square roots are rounded, but processors and
libraries differ in the order of sums, in whether a product and a sum are rounded once or twice, and
in the last digits of `exp`, `log` and `tanh`. Here all of that is fixed: each number of a matrix
product is one chain of fused multiplications and additions, in the order of the inner index. Arrays
are of float32, or float64 in tests.
"""

import math
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
from llvmlite import ir
from numba import njit, types
from numba.core import cgutils, typing
from numba.core.base import BaseContext
from numba.extending import intrinsic
from numpy.typing import NDArray

LANES = 16  # columns of a product that are computed together; arrays are padded to a multiple
_ROWS = 6  # rows computed together: AVX2's registers hold 6 x 16 sums of float32

_F = np.float32
_EXP = tuple(1.0 / math.factorial(k) for k in range(13, -1, -1))
_ARTANH = tuple(1.0 / k for k in range(21, -1, -2))

Numbers = NDArray[np.floating[Any]]
Kind = type[np.floating[Any]]  # the type of an agent's numbers
Vector = tuple[Numbers, int]  # a flat array, and where in it the vector begins
Matrix = tuple[
    Numbers, int, int, int
]  # the same, and the distances from row to row and column to column

# For functions that compiled code calls. With Python's model of errors, a loop that divides has an
# exit for zero, which keeps numba from vectorising it.
inlined = njit(error_model="numpy", no_cpython_wrapper=True, no_cfunc_wrapper=True)


def _block(n_rows: int) -> Callable[..., None]:
    """Returns compiled code for some rows and `LANES` columns of a product, see `multiply`."""

    @intrinsic
    def block(
        _: typing.Context, operands: types.BaseTuple
    ) -> tuple[typing.Signature, Callable[..., ir.Value]]:
        return types.void(operands), partial(_build, n_rows)

    return block  # type: ignore[no-any-return]


def _build(
    n_rows: int,
    context: BaseContext,
    builder: ir.IRBuilder,
    signature: typing.Signature,
    arguments: list[ir.Value],
) -> ir.Value:
    """Writes the instructions of `_block` for the operands of `multiply`.

    numba cannot say that a product and a sum are rounded once. In C, with vectors of `LANES`
    numbers:

        for (r...) total[r] = start;
        for (k = 0; k < n_inner; k++)
            for (r...) total[r] = fma(a[r * a_row + k * a_inner], b[k * b_inner ...], total[r]);
        for (r...) c[r * c_row ...] = total[r];
    """
    kinds = signature.args[0]
    values = cgutils.unpack_tuple(builder, arguments[0])
    start, a, b, c = (
        builder.gep(context.make_array(kinds[i])(context, builder, values[i]).data, [values[i + 1]])
        for i in (0, 2, 6, 9)
    )
    a_row, a_inner, b_inner, c_row, n_inner = (values[i] for i in (4, 5, 8, 11, 12))
    number = context.get_data_type(kinds[0].dtype)
    index = ir.IntType(64)
    vector = ir.VectorType(number, LANES)
    n_bytes = kinds[0].dtype.bitwidth // 8
    fma = builder.module.declare_intrinsic(
        f"llvm.fma.v{LANES}f{8 * n_bytes}", fnty=ir.FunctionType(vector, [vector] * 3)
    )
    undefined = ir.Constant(vector, ir.Undefined)
    all_first = ir.Constant(ir.VectorType(ir.IntType(32), LANES), [0] * LANES)

    def at(array: ir.Value, i: ir.Value, stride: ir.Value) -> ir.Value:
        return builder.gep(array, [builder.mul(i, stride)])

    def vector_at(pointer: ir.Value) -> ir.Value:
        return builder.bitcast(pointer, vector.as_pointer())

    rows = [at(a, index(r), a_row) for r in range(n_rows)]
    first = builder.load(vector_at(start), align=n_bytes)
    totals = [cgutils.alloca_once_value(builder, first) for _ in rows]  # registers, once optimised
    with cgutils.for_range(builder, n_inner) as loop:
        factors = builder.load(vector_at(at(b, loop.index, b_inner)), align=n_bytes)
        for row, total in zip(rows, totals, strict=True):
            number = builder.load(at(row, loop.index, a_inner))
            factor = builder.insert_element(undefined, number, ir.IntType(32)(0))
            repeated = builder.shuffle_vector(factor, undefined, all_first)
            sums = builder.call(fma, [repeated, factors, builder.load(total)])
            builder.store(sums, total)
    for r, total in enumerate(totals):
        builder.store(builder.load(total), vector_at(at(c, index(r), c_row)), align=n_bytes)
    return context.get_dummy_value()


_six = _block(_ROWS)
_two = _block(2)
_one = _block(1)


@inlined
def multiply(shape: tuple[int, int, int], start: Vector, a: Matrix, b: Matrix, c: Matrix) -> None:
    """Multiplies matrices: c[r, j] = start[j] + sum of a[r, k] * b[k, j] over k, in this order.

    `shape` is (rows of a and c, columns of b and c, columns of a and rows of b); the second is a
    multiple of `LANES`. The columns of b and c are contiguous. Nothing is checked.
    """
    n_rows, n_columns, n_inner = shape
    (starts, start_at), (a_numbers, a_at, a_row, a_inner) = start, a
    (b_numbers, b_at, b_inner, _), (c_numbers, c_at, c_row, _) = b, c
    for j in range(0, n_columns, LANES):
        r = 0
        while r < n_rows:
            operands = (
                starts, start_at + j, a_numbers, a_at + r * a_row, a_row, a_inner,
                b_numbers, b_at + j, b_inner, c_numbers, c_at + r * c_row + j, c_row, n_inner,
            )  # fmt: skip
            if r + _ROWS <= n_rows:
                _six(operands)
                r += _ROWS
            elif r + 2 <= n_rows:
                _two(operands)
                r += 2
            else:
                _one(operands)
                r += 1


@inlined
def like(numbers: Numbers, value: float) -> Any:
    """Returns a value in the type of an array's numbers."""
    return numbers.dtype.type(value)


@inlined
def exp(x: float) -> float:
    """Returns e**x, float64, within 3e-16 of its size.

    With n the nearest whole number to x / log(2), it is 2**n * e**r, where |r| < 0.35, by e**r's
    series.
    """
    if not x < 709.0:  # or NaN
        return x + np.inf
    if x < -708.0:
        return 0.0
    n = math.floor(x * 1.4426950408889634 + 0.5)
    r = (x - n * 0.693147180369123816490) - n * 1.90821492927058770002e-10  # log(2), in two parts
    total = 0.0
    for coefficient in _EXP:
        total = total * r + coefficient
    return math.ldexp(total, int(n))


@inlined
def log(x: float) -> float:
    """Returns the logarithm of a positive normal float64, within 3e-16 of its size and 1e-16.

    With x = m * 2**n, where m is near 1, it is n * log(2) + 2 * artanh((m - 1) / (m + 1)), by its
    series.
    """
    m, n = math.frexp(x)
    if m < 0.7071067811865476:
        m = 2.0 * m
        n = n - 1
    f = (m - 1.0) / (m + 1.0)
    square = f * f
    total = 0.0
    for coefficient in _ARTANH:
        total = total * square + coefficient
    return n * 0.6931471805599453 + 2.0 * f * total


@inlined
def tanh(values: Numbers) -> None:
    """Replaces numbers by their tanh: of float32 by Eigen's rational function, within 4e-7."""
    if values.itemsize == 8:
        for i in range(len(values)):
            values[i] = math.tanh(values[i])
        return
    for i in range(len(values)):
        x = values[i]  # beyond the bound, the tangent is that of the bound, 2e-7 from 1
        x = _F(-7.99881172180175781) if x < _F(-7.99881172180175781) else x
        x = _F(7.99881172180175781) if x > _F(7.99881172180175781) else x
        s = x * x
        p = _F(-2.76076847742355e-16) * s + _F(2.00018790482477e-13)
        p = p * s + _F(-8.60467152213735e-11)
        p = p * s + _F(5.12229709037114e-08)
        p = p * s + _F(1.48572235717979e-05)
        p = p * s + _F(6.37261928875436e-04)
        p = p * s + _F(4.89352455891786e-03)
        q = _F(1.19825839466702e-06) * s + _F(1.18534705686654e-04)
        q = q * s + _F(2.26843463243900e-03)
        q = q * s + _F(4.89352518554385e-03)
        values[i] = x * p / q
