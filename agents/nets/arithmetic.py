"""Arithmetic whose bits are the same on every processor, in compiled code.

Sums, products, quotients and square roots are rounded as IEEE 754 says, everywhere. What differs between
processors and libraries is the order in which products of matrices are summed up, whether a product and a sum
are rounded once or twice, and the last digit of `exp`, `log` and `tanh`. Here all of that is fixed: a number
of a product is one chain of fused multiplications and additions, in the order of the inner index. It does not
depend on how many rows are multiplied together, nor on the width of the vector registers.

All functions take float32, which nets are trained in, or float64.
"""

import math
from typing import Any, Final

import numba
import numpy as np
from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic, overload
from numpy.typing import NDArray

LANES: Final = 16  # columns of a product that are computed together; arrays are padded to a multiple
_ROWS: Final = 6  # rows that are: with 16 columns of float32, the registers of AVX2 hold their sums

_EXP: Final = tuple(1.0 / math.factorial(k) for k in range(13, -1, -1))
_ARTANH: Final = tuple(1.0 / k for k in range(21, -1, -2))

Numbers = NDArray[np.floating[Any]]
Vector = tuple[Numbers, int]  # a flat array, and where in it the vector begins
Matrix = tuple[Numbers, int, int, int]  # the same, and how far it is from row to row, and column to column

# For functions that compiled code calls. In Python's model of errors, a loop that divides has an exit for
# zero, and then numba uses no vector registers.
inlined: Final = numba.njit(error_model="numpy", no_cpython_wrapper=True, no_cfunc_wrapper=True)


def _block(n_rows: int) -> Any:
    """Returns compiled code for some rows and `LANES` columns of a product, see `multiply`.

    numba cannot say that a product and a sum are to be rounded once, so this is written for LLVM.
    """

    @intrinsic
    def block(_: Any, operands: Any) -> Any:
        return types.void(operands), lambda context, builder, signature, values: _build(
            context, builder, signature.args[0], cgutils.unpack_tuple(builder, values[0]), n_rows
        )

    return block


def _build(context: Any, builder: Any, kinds: Any, values: Any, n_rows: int) -> Any:
    """Writes the instructions of `_block`; the operands are those of `multiply`, for a block."""
    start, a, b, c = (
        builder.gep(context.make_array(kinds[i])(context, builder, values[i]).data, [values[i + 1]])
        for i in (0, 2, 6, 9)
    )
    a_row, a_inner, b_inner, c_row, n_inner = (values[i] for i in (4, 5, 8, 11, 12))
    number, place = context.get_data_type(kinds[0].dtype), ir.IntType(64)
    vector = ir.VectorType(number, LANES)
    bits = kinds[0].dtype.bitwidth
    signature = ir.FunctionType(vector, [vector] * 3)
    fma = cgutils.get_or_insert_function(builder.module, signature, f"llvm.fma.v{LANES}f{bits}")
    everywhere = ir.Constant(ir.VectorType(ir.IntType(32), LANES), [0] * LANES)
    undefined = ir.Constant(vector, ir.Undefined)

    def at(array: Any, i: Any, stride: Any) -> Any:
        return builder.gep(array, [builder.mul(i, stride)])

    def vector_at(pointer: Any) -> Any:
        return builder.bitcast(pointer, vector.as_pointer())

    rows = [at(a, place(r), a_row) for r in range(n_rows)]
    first = builder.load(vector_at(start), align=bits // 8)
    before = builder.block
    loop, after = builder.append_basic_block(), builder.append_basic_block()
    builder.branch(loop)
    builder.position_at_end(loop)
    inner = builder.phi(place)
    totals = [builder.phi(vector) for _ in rows]
    factors = builder.load(vector_at(at(b, inner, b_inner)), align=bits // 8)
    sums = []
    for row, total in zip(rows, totals, strict=True):
        factor = builder.insert_element(undefined, builder.load(at(row, inner, a_inner)), ir.IntType(32)(0))
        factor = builder.shuffle_vector(factor, undefined, everywhere)
        sums.append(builder.call(fma, [factor, factors, total]))
        total.add_incoming(first, before)
        total.add_incoming(sums[-1], loop)
    following = builder.add(inner, place(1))
    inner.add_incoming(place(0), before)
    inner.add_incoming(following, loop)
    builder.cbranch(builder.icmp_signed("<", following, n_inner), loop, after)
    builder.position_at_end(after)
    for r, total in enumerate(sums):
        builder.store(total, vector_at(at(c, place(r), c_row)), align=bits // 8)
    return context.get_dummy_value()


_six, _two, _one = _block(_ROWS), _block(2), _block(1)


@inlined
def multiply(shape: tuple[int, int, int], start: Vector, a: Matrix, b: Matrix, c: Matrix) -> None:
    """Multiplies matrices: c[r, j] = start[j] + sum of a[r, k] * b[k, j] over k, in this order.

    Nothing is checked.

    Args:
      shape: Rows of a and c; columns of b and c, a multiple of `LANES`; columns of a and rows of b.
      start: What the sums begin with, the same in all rows.
      a: The first factor.
      b: The second factor, from column to column 1.
      c: The product, from column to column 1.
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


def like(numbers: Any, value: Any) -> Any:
    """Returns a value in the type of an array's numbers, in compiled code."""
    raise NotImplementedError


@overload(like)
def _like(numbers: Any, value: Any) -> Any:  # noqa: ARG001
    kind = numbers.dtype

    def converted(numbers: Any, value: Any) -> Any:  # noqa: ARG001
        return kind(value)

    return converted


@inlined
def exp(x: float) -> float:
    """Returns e**x, float64, within 2e-16 of its size.

    With n the nearest whole number to x / log(2), it is 2**n * e**r, where |r| < 0.35, by e**r's series.
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
    """Returns the logarithm of a positive normal number, float64, within 2e-16 of its size and 1e-16.

    With x = m * 2**n, where m is near 1, it is n * log(2) + 2 * artanh((m - 1) / (m + 1)), by its series.
    """
    m, n = math.frexp(x)
    if m < 0.7071067811865476:
        m, n = 2.0 * m, n - 1
    f = (m - 1.0) / (m + 1.0)
    square, total = f * f, 0.0
    for coefficient in _ARTANH:
        total = total * square + coefficient
    return n * 0.6931471805599453 + 2.0 * f * total


def tanh(values: Any) -> Any:
    """Replaces float32 numbers by their hyperbolic tangents, within 3e-7, in compiled code.

    A rational function takes a tenth of the time of the C library's. Numbers of float64, in which tests
    compare with other implementations, get the C library's.
    """
    raise NotImplementedError


@overload(tanh, jit_options={"error_model": "numpy"})
def _tanh(values: Any) -> Any:
    if values.dtype == types.float64:

        def of_library(values: Any) -> Any:
            for i in range(len(values)):
                values[i] = math.tanh(values[i])

        return of_library

    F = np.float32  # noqa: N806

    def rational(values: Any) -> Any:
        for i in range(len(values)):
            # A larger number has the tangent of the bound, 1 in float32.
            x = values[i]
            x = F(-7.99881172180175781) if x < F(-7.99881172180175781) else x
            x = F(7.99881172180175781) if x > F(7.99881172180175781) else x
            s = x * x
            p = F(-2.76076847742355e-16) * s + F(2.00018790482477e-13)
            p = p * s + F(-8.60467152213735e-11)
            p = p * s + F(5.12229709037114e-08)
            p = p * s + F(1.48572235717979e-05)
            p = p * s + F(6.37261928875436e-04)
            p = p * s + F(4.89352455891786e-03)
            q = F(1.19825839466702e-06) * s + F(1.18534705686654e-04)
            q = q * s + F(2.26843463243900e-03)
            q = q * s + F(4.89352518554385e-03)
            values[i] = x * p / q

    return rational
