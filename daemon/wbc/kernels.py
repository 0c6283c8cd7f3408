"""Compiled: strict priorities as one walk down the levels, and the search for the active bounds around it. Allocates nothing.

Every row is whitened (a L⁻¹ with M = Lᵀ L, Featherstone's factor: it keeps a limb's rows on its own joints) and of unit length.
A walk takes the rows in order of priority: each is freed of the directions that earlier rows own (Gram-Schmidt), moves y along
what is left until it is met, and owns that direction from then on. So a level is met exactly, as well as what is above it
allows, and nothing below can disturb it (Siciliano and Slotine 1991; with whitening: Khatib 1987, dynamically consistent).

Near a singularity of a level its smallest singular values are filtered instead (Maciejewski and Klein 1988), and directions that
all but vanish are given up softly: both are continuous in the state, so a change of rank is no jump.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from daemon.wbc import layout as at
from daemon.wbc.memory import copy, fill, line, matrix, vector
from daemon.wbc.rows import bounded_rows, force_rows, posture_accelerations, task_rows
from daemon.wbc.vectors import FAST
from handrail.compiled import compiled

SINGULAR, SINGULAR_AT_BOUNDS = 5e-3, 1e-6
"""sin² of the angle below which a direction of a level is damped, as much at most; where bounds are active they keep a command from
growing, and what is damped there would not be the best that they allow"""
_KEEP, GIVE_UP = 1e-6, 1e-8
"""sin² of the angle to what is above: a direction is owned wholly above, and not at all below"""
_NOTHING = 1e-12
_DEPENDENT, _DEPENDENT_BOUND = 1e-10, 1e-8
"""sin² to what is owned below which an equality, an active bound says nothing new"""
_ROW_TOLERANCE = 1e-8
"""rad/s², N·m, N: by which a bound may be exceeded, times 1 + its own size"""
_ROUNDING = 1e-6
"""likewise, by rounding, where several bounds are active"""
_MULTIPLIER_TOLERANCE = 1e-9
RISE, FALL = 25, 100
"""cycles in which λ of min |A y − a|² + λ² |y|² comes up where a level is singular or a bound is active (Nakamura and Hanafusa
1986; the same whatever is active, so that it stays one problem), and in which it goes again"""
_LEAST_OWNED = 0.07
"""sine to what is above up to which a direction is shared with the levels below, where λ is as large"""
WALKS = 3
"""walks that take in and let go bounds many at a time, before going down step by step"""


@njit(fastmath=FAST, error_model="numpy")
def _factor(mass, low):  # type: ignore[no-untyped-def]
    """low: L with M = Lᵀ L from M's lower triangle (Featherstone 2008, §6.5). Returns whether M is positive."""
    n = low.shape[0]
    for i in range(n):
        for j in range(i + 1):
            low[i, j] = mass[i, j]
    for k in range(n - 1, -1, -1):
        row = low[k]
        if not row[k] > 0.0:
            return False
        pivot = math.sqrt(row[k])
        row[k] = pivot
        for j in range(k):
            row[j] /= pivot
        for i in range(k):
            s = row[i]
            if s != 0.0:
                other = low[i]
                for j in range(i + 1):
                    other[j] -= s * row[j]
    return True


@njit(fastmath=FAST, error_model="numpy")
def _dot(a, b, n):  # type: ignore[no-untyped-def]
    s = 0.0
    for i in range(n):
        s += a[i] * b[i]
    return s


@njit(fastmath=FAST, error_model="numpy")
def _free(row, basis, share, count):  # type: ignore[no-untyped-def]
    """Take the first `count` owned directions out of a row, in place."""
    n = row.shape[0]
    for c in range(count):
        direction = basis[c]
        s = share[c] * _dot(direction, row, n)
        for j in range(n):
            row[j] -= s * direction[j]


@njit(fastmath=FAST, error_model="numpy")
def _free_of_whole(row, basis, share, count):  # type: ignore[no-untyped-def]
    """Likewise, but of those alone that are owned wholly."""
    n = row.shape[0]
    for c in range(count):
        if share[c] == 1.0:
            direction = basis[c]
            s = _dot(direction, row, n)
            for j in range(n):
                row[j] -= s * direction[j]


@njit(fastmath=FAST, error_model="numpy")
def _force_scales(table, plan, sizes, scale):  # type: ignore[no-untyped-def]
    """σ of every force coordinate: forces and moments."""
    settings = vector(table, at.SETTINGS)
    for k in range(sizes[at.TASKS]):
        coordinate = plan[k, at.FORCE_FIRST]
        kind = plan[k, at.KIND]
        if coordinate < 0 or not (kind == at.POSE_KIND or (kind == at.WRENCH_KIND and not plan[k, at.SLOT])):
            continue
        for i in range(6):
            if plan[k, at.MASK] & (1 << i):
                scale[coordinate] = settings[at.FORCE_SCALE] if i < 3 else settings[at.MOMENT_SCALE]
                coordinate += 1


@njit(fastmath=FAST, error_model="numpy")
def _unit(low, row, scale):  # type: ignore[no-untyped-def]
    """Whiten a row of x in place and make it of unit length. Returns its length, 0 for a row of nothing."""
    nv, n = low.shape[0], row.shape[0]
    for i in range(nv - 1, -1, -1):
        if row[i] != 0.0:
            factor = low[i]
            s = row[i] / factor[i]
            row[i] = s
            for j in range(i):
                row[j] -= s * factor[j]
    for i in range(nv, n):
        row[i] *= scale[i - nv]
    length = math.sqrt(_dot(row, row, n))
    if not length > 1e-9:
        fill(row, 0.0)
        return 0.0
    for i in range(n):
        row[i] /= length
    return length


@njit(fastmath=FAST, error_model="numpy")
def _ready_level(table, plan, support, roots, levels, sizes, level):  # type: ignore[no-untyped-def]
    """Fill in the unit rows of a level."""
    raw, known, low = matrix(table, at.RAW), matrix(table, at.ROW), matrix(table, at.FACTOR)
    parameters, scale = matrix(table, at.PARAMETERS), vector(table, at.FORCE_SCALES)
    wanted = known[at.WANTED]
    nv, n = sizes[at.NV], sizes[at.N]
    for k in range(levels[level, 0], levels[level, 0] + levels[level, 1]):
        if k == sizes[at.POSTURE_TASK]:
            continue
        first, count = plan[k, at.FIRST], plan[k, at.COUNT]
        if plan[k, at.ON] == 0:
            for row in range(first, first + count):
                fill(raw[row], 0.0)
                known[at.LENGTH, row] = 0.0
            continue
        task_rows(table, plan, support, roots, nv, n, k, raw, wanted, first)
        for row in range(first, first + count):
            length = _unit(low, raw[row], scale)
            known[at.LENGTH, row] = length
            if length > 0.0:
                wanted[row] /= length
            known[at.ROW_WEIGHT, row] = parameters[k, at.WEIGHT]


@njit(fastmath=FAST, error_model="numpy")
def _eigen(a, vectors):  # type: ignore[no-untyped-def]
    """Eigenvalues of a symmetric matrix on its diagonal, eigenvectors by columns: cyclic Jacobi (Golub and Van Loan, §8.5)."""
    n = a.shape[0]
    for i in range(n):
        for j in range(n):
            vectors[i, j] = 1.0 if i == j else 0.0
    for _ in range(30):
        off = 0.0
        for i in range(n):
            for j in range(i):
                off += a[i, j] * a[i, j]
        if off < 1e-26:
            return
        for p in range(n - 1):
            for q in range(p + 1, n):
                if abs(a[p, q]) < 1e-18:
                    continue
                theta = (a[q, q] - a[p, p]) / (2.0 * a[p, q])
                t = (1.0 if theta >= 0.0 else -1.0) / (abs(theta) + math.sqrt(theta * theta + 1.0))
                c = 1.0 / math.sqrt(t * t + 1.0)
                s = t * c
                for i in range(n):
                    u, v = a[i, p], a[i, q]
                    a[i, p], a[i, q] = c * u - s * v, s * u + c * v
                for i in range(n):
                    u, v = a[p, i], a[q, i]
                    a[p, i], a[q, i] = c * u - s * v, s * u + c * v
                for i in range(n):
                    u, v = vectors[i, p], vectors[i, q]
                    vectors[i, p], vectors[i, q] = c * u - s * v, s * u + c * v


@njit(fastmath=FAST, error_model="numpy")
def _filtered(table, first_row, rows, kept, first, count, y, start, singular, damping):  # type: ignore[no-untyped-def]
    """Move y from `start` along the level's own directions first … count, with the level's small singular values filtered.

    The rows in these directions are R (rows, d), `kept`; RᵀR = V Λ Vᵀ. With weights D, left singular vectors U = R V Λ^-½ and
    the residual e: t = argmin |D (U t − e)|² + Σ (δ_i / λ_i) t_i², z = V Λ^-½ t, where δ(λ) is smooth and 0 for λ ≥ singular.
    Without weights that is z = V (Λ + δ)⁻¹ Vᵀ Rᵀ e. Returns the smallest eigenvalue.
    """
    d, n = count - first, y.shape[0]
    raw, known, basis, work = (
        matrix(table, at.RAW),
        matrix(table, at.ROW),
        matrix(table, at.BASIS),
        matrix(table, at.GRAM),
    )
    wide = work.shape[1]
    gram, vectors, left = work[:d, :d], work[wide : wide + d, :d], work[2 * wide : 2 * wide + rows, :d]
    normal, error, t = work[3 * wide : 3 * wide + d, :d], work[4 * wide], work[5 * wide]
    heaviest, even = 0.0, True
    for i in range(rows):
        row = first_row + i
        error[i] = known[at.WANTED, row] - _dot(raw[row], start, n)
        heaviest = max(heaviest, known[at.ROW_WEIGHT, row])
        even = even and known[at.ROW_WEIGHT, row] == known[at.ROW_WEIGHT, first_row]
    for i in range(d):
        for j in range(d):
            s = 0.0
            for r in range(rows):
                s += kept[r, first + i] * kept[r, first + j]
            gram[i, j] = s
    _eigen(gram, vectors)
    least = 1.0
    for i in range(d):
        least = min(least, gram[i, i])
    for r in range(rows):
        for i in range(d):
            s = 0.0
            for j in range(d):
                s += kept[r, first + j] * vectors[j, i]
            left[r, i] = s / math.sqrt(max(gram[i, i], _NOTHING))
    for i in range(d):
        s = 0.0
        for r in range(rows):
            w = 1.0 if even else known[at.ROW_WEIGHT, first_row + r] / heaviest
            s += w * w * left[r, i] * error[r]
        t[i] = s
        for j in range(i + 1):
            s = 0.0
            if even:
                s = 1.0 if i == j else 0.0
            else:
                for r in range(rows):
                    w = known[at.ROW_WEIGHT, first_row + r] / heaviest
                    s += w * w * left[r, i] * left[r, j]
            if i == j and gram[i, i] < singular:
                u = 1.0 - max(gram[i, i], 0.0) / singular
                s += singular * u * u / max(gram[i, i], _NOTHING)
            if i == j:
                s += damping / max(gram[i, i], _NOTHING)
            normal[i, j] = s
    for i in range(d):  # Cholesky, and both substitutions
        for j in range(i + 1):
            s = normal[i, j]
            for c in range(j):
                s -= normal[i, c] * normal[j, c]
            normal[i, j] = math.sqrt(max(s, 1e-12)) if i == j else s / normal[j, j]
        s = t[i]
        for c in range(i):
            s -= normal[i, c] * t[c]
        t[i] = s / normal[i, i]
    for i in range(d - 1, -1, -1):
        s = t[i]
        for c in range(i + 1, d):
            s -= normal[c, i] * t[c]
        t[i] = s / normal[i, i]
    for j in range(n):
        y[j] = start[j]
    for i in range(d):
        size = t[i] / math.sqrt(max(gram[i, i], _NOTHING))
        for c in range(d):
            s = size * vectors[c, i]
            direction = basis[first + c]
            for j in range(n):
                y[j] += s * direction[j]
    return least


@njit(fastmath=FAST, error_model="numpy")
def _own(basis, owned, count, row, source, share, length):  # type: ignore[no-untyped-def]
    """A new direction: a freed row of this length."""
    direction = basis[count]
    for j in range(row.shape[0]):
        direction[j] = row[j] / length
    owned[0, count], owned[1, count], owned[2, count] = share, source, length


@njit(fastmath=FAST, error_model="numpy")
def _equalities(table, levels, sizes):  # type: ignore[no-untyped-def]
    """Meet level 0 (contacts, the free base's dynamics, transmissions) exactly. Returns directions owned, −1 − row for one that
    contradicts those before it."""
    raw, freed, known = matrix(table, at.RAW), matrix(table, at.PROJECTED), matrix(table, at.ROW)
    basis, owned = matrix(table, at.BASIS), matrix(table, at.OWNED)
    y, n, count = line(table, at.Y, 0), sizes[at.N], 0
    fill(y, 0.0)
    for i in range(sizes[at.EQUALITIES]):
        if known[at.LENGTH, i] == 0.0:
            continue
        row = freed[i]
        copy(raw[i], row)
        _free(row, basis, owned[0], count)
        _free(row, basis, owned[0], count)
        t = _dot(row, row, n)
        missing = known[at.WANTED, i] - _dot(raw[i], y, n)
        if t < _DEPENDENT:
            if abs(missing) > 1e-6 * (1.0 + abs(known[at.WANTED, i])):
                sizes[at.CULPRIT] = i
                return -1 - i
            continue
        length = math.sqrt(t)
        _own(basis, owned, count, row, i, 1.0, length)
        s = missing / length
        for j in range(n):
            y[j] += s * basis[count, j]
        count += 1
    copy(y, line(table, at.Y, 3))
    return count


@njit(fastmath=FAST, error_model="numpy")
def _meet_bound(table, sizes, a, count, y):  # type: ignore[no-untyped-def]
    """Bring y onto active bound a, and own its direction. Returns the count of directions: as it was where the bound depends on
    what is owned already."""
    basis, owned = matrix(table, at.BASIS), matrix(table, at.OWNED)
    row, trial, n = line(table, at.ACTIVE_ROW, a), line(table, at.Y, 2), sizes[at.N]
    # Not of what is shared with the levels below: those would then leave the bound.
    copy(row, trial)
    _free_of_whole(trial, basis, owned[0], count)
    _free_of_whole(trial, basis, owned[0], count)
    t = _dot(trial, trial, n)
    if t < _DEPENDENT_BOUND or count >= basis.shape[0]:
        return count
    length = math.sqrt(t)
    s = (matrix(table, at.ACTIVE)[0, a] - _dot(row, y, n)) / length
    _own(basis, owned, count, trial, -1.0 - a, 1.0, length)
    for j in range(n):
        y[j] += s * basis[count, j]
    return count + 1


@njit(fastmath=FAST, error_model="numpy")
def _meet_level(table, levels, sizes, level, count, whole, y):  # type: ignore[no-untyped-def]
    """Bring y to the best that a level can have beside what is owned. Returns (directions, directions owned wholly)."""
    raw, freed, known = matrix(table, at.RAW), matrix(table, at.PROJECTED), matrix(table, at.ROW)
    basis, owned, within = matrix(table, at.BASIS), matrix(table, at.OWNED), matrix(table, at.WITHIN)
    about, start = matrix(table, at.LEVEL), line(table, at.Y, 1)
    share, n, room = owned[0], sizes[at.N], basis.shape[0]
    first_row, rows = levels[level, 2], levels[level, 3]
    damping, most = vector(table, at.SETTINGS)[at.DAMPING], vector(table, at.SETTINGS)[at.MOST_DAMPING]
    copy(y, start)
    first, volume = count, 1.0
    for i in range(first_row, first_row + rows):
        if known[at.LENGTH, i] == 0.0:
            continue
        row = freed[i]
        copy(raw[i], row)
        _free(row, basis, share, count)
        t = _dot(row, row, n)
        if t < 0.1:  # of what was taken out by half, half is left
            _free_of_whole(row, basis, share, count)
            t = _dot(row, row, n)
        volume *= t
        if t < _NOTHING or count >= room:
            volume = 0.0
            continue
        length = math.sqrt(t)
        # Among the level's own every direction counts as owned wholly: they are at right angles.
        _own(basis, owned, count, row, i, 1.0, length)
        s = (known[at.WANTED, i] - _dot(raw[i], y, n)) / length
        for j in range(n):
            y[j] += s * basis[count, j]
        count += 1
    # The smallest eigenvalue of RRᵀ is at least det · ((r − 1) / r)^(r − 1) ≥ det / e.
    near = SINGULAR if sizes[at.ACTIVE_COUNT] == 0 else SINGULAR_AT_BOUNDS
    singular = near * (1.0 - damping / most) if most > 0.0 else near  # what damps all directions takes over from it
    for c in range(first, count):
        t = owned[2, c] * owned[2, c]
        u = min(max((t - GIVE_UP) / (_KEEP - GIVE_UP), 0.0), 1.0)
        if damping > 0.0:
            u = min(u, owned[2, c] / min(damping, _LEAST_OWNED))
        share[c] = u * u * (3.0 - 2.0 * u)
        if share[c] == 1.0:
            whole += 1
    damping *= damping
    if (volume < 2.8 * near or damping > 0.0) and count > first:
        kept = within[first_row : first_row + rows]
        for i in range(rows):
            for c in range(first, count):
                kept[i, c] = _dot(raw[first_row + i], basis[c], n)
        least = _filtered(table, first_row, rows, kept, first, count, y, start, singular, damping)
        about[at.LEAST, level] = least
        about[at.FILTERED, level] = 1.0 if least < near or volume < _NOTHING else 0.0
    elif count == first:
        about[at.LEAST, level], about[at.FILTERED, level] = 0.0, 1.0
    return count, whole


@njit(fastmath=FAST, error_model="numpy")
def _meet_rest(table, sizes, count, y):  # type: ignore[no-untyped-def]
    """Bring y as near as what is owned lets it to the posture, or to 0: what no level asks for."""
    basis, owned, target = matrix(table, at.BASIS), matrix(table, at.OWNED), vector(table, at.POSTURE_TARGET)
    trial, n = line(table, at.Y, 2), sizes[at.N]
    for j in range(n):
        trial[j] = target[j] - y[j]
    _free(trial, basis, owned[0], count)
    for j in range(n):
        y[j] += trial[j]


@njit(fastmath=FAST, error_model="numpy")
def _walk(table, plan, support, roots, levels, sizes, fixed, all_levels):  # type: ignore[no-untyped-def]
    """One walk down the levels with the active bounds met first; y is the solution. `fixed`: directions that the equalities own.

    `all_levels`: fill in the rows of levels that have no freedom left, too.
    """
    about, y, n = matrix(table, at.LEVEL), line(table, at.Y, 0), sizes[at.N]
    sizes[at.PASSES] += 1
    copy(line(table, at.Y, 3), y)
    count = fixed
    for a in range(sizes[at.ACTIVE_COUNT]):
        count = _meet_bound(table, sizes, a, count, y)
    whole, last = count, sizes[at.LEVELS]
    for level in range(1, last):
        about[at.FREE_LEFT, level], about[at.LEAST, level], about[at.FILTERED, level] = n - whole, 1.0, 0.0
        about[at.LEVEL_HEIGHT, level] = count
        rows = levels[level, 3]
        if whole >= n and not all_levels:
            about[at.LEAST, level] = 0.0
            continue
        if sizes[at.READY] <= level:
            _ready_level(table, plan, support, roots, levels, sizes, level)
            sizes[at.READY] = level + 1
        if whole >= n:
            about[at.LEAST, level] = 0.0
        elif rows:
            count, whole = _meet_level(table, levels, sizes, level, count, whole, y)
    about[at.LEVEL_HEIGHT, last], about[at.FREE_LEFT, last] = count, n - whole
    if whole < n:
        _meet_rest(table, sizes, count, y)


@njit(fastmath=FAST, error_model="numpy")
def _first_in_the_way(table, sizes, bounds, here, there):  # type: ignore[no-untyped-def]
    """(bound, side, share of the way): which is met first from values `here`, which keep all bounds, to `there`; −1: none."""
    bound = matrix(table, at.BOUND)
    least, blocker, side = 1.0, -1, 0
    for i in range(2 * sizes[at.NV] + sizes[at.BOUNDED_ROWS]):
        upward = there[i] - bound[1, i] > bound[0, i] - there[i]
        limit = bound[1, i] if upward else bound[0, i]
        over = there[i] - limit if upward else limit - there[i]
        if not over > _ROW_TOLERANCE * (1.0 + abs(limit)):
            continue
        known = False
        for a in range(sizes[at.ACTIVE_COUNT]):
            known = known or bounds[a, 0] == i
        if known and over < _ROUNDING * (1.0 + abs(limit)):
            continue
        step = abs(there[i] - here[i])
        share = max(1.0 - over / step, 0.0) if step > 0.0 else 0.0
        if share < least:
            least, blocker, side = share, i, 1 if upward else -1
    return blocker, side, least


@njit(fastmath=FAST, error_model="numpy")
def _multipliers(table, levels, sizes, level, before, until, y):  # type: ignore[no-untyped-def]
    """Of the directions before … until that are active bounds, for a level: into `active`. Returns the most negative's, or −1.

    They solve A_kᵀ r_k + Σ_{j<k} A_jᵀ μ_j + Cᵀ λ = 0, backwards along the basis.
    """
    raw, known, target = matrix(table, at.RAW), matrix(table, at.ROW), vector(table, at.POSTURE_TARGET)
    basis, owned, active = matrix(table, at.BASIS), matrix(table, at.OWNED), matrix(table, at.ACTIVE)
    active_row, pull, n = matrix(table, at.ACTIVE_ROW), line(table, at.Y, 1), sizes[at.N]
    damping, heaviest = vector(table, at.SETTINGS)[at.DAMPING], 0.0
    damping *= damping
    size = 0.0
    fill(pull, 0.0)
    if level < sizes[at.LEVELS]:
        for i in range(levels[level, 2], levels[level, 2] + levels[level, 3]):
            if known[at.LENGTH, i] == 0.0:
                continue
            weight = known[at.ROW_WEIGHT, i]
            s = weight * weight * (known[at.WANTED, i] - _dot(raw[i], y, n))
            size, heaviest = max(size, abs(s)), max(heaviest, weight)
            for j in range(n):
                pull[j] += s * raw[i, j]
        damping *= heaviest * heaviest
        for j in range(n):
            pull[j] -= damping * y[j]
            size = max(size, damping * abs(y[j]))
    else:
        for j in range(n):
            pull[j] = target[j] - y[j]
            size = max(size, abs(pull[j]))
    tolerance, worst, worst_at = _MULTIPLIER_TOLERANCE * (1.0 + size), 0.0, -1
    for c in range(until - 1, before - 1, -1):
        source = int(owned[1, c])
        if owned[0, c] < 1.0:
            continue
        s = _dot(basis[c], pull, n) / owned[2, c] if size > 1e-10 else 0.0
        other = active_row[-1 - source] if source < 0 else raw[source]
        for j in range(n):
            pull[j] -= s * other[j]
        if source < 0:
            a = -1 - source
            active[2, a] = s if abs(s) > tolerance else 0.0
            if active[2, a] < worst:
                worst, worst_at = s, a
    return worst_at


@njit(fastmath=FAST, error_model="numpy")
def _damping_presses(table, levels, sizes, level, y):  # type: ignore[no-untyped-def]
    """Multipliers up to this may be of a level's damping, instead of its tasks."""
    if level >= sizes[at.LEVELS]:
        return 0.0
    damping, known, heaviest = vector(table, at.SETTINGS)[at.DAMPING], matrix(table, at.ROW), 0.0
    for i in range(levels[level, 2], levels[level, 2] + levels[level, 3]):
        heaviest = max(heaviest, known[at.ROW_WEIGHT, i] if known[at.LENGTH, i] > 0.0 else 0.0)
    return damping * damping * heaviest * heaviest * math.sqrt(_dot(y, y, sizes[at.N]))


@njit(fastmath=FAST, error_model="numpy")
def _descend(table, plan, support, roots, levels, sizes, bounds, fixed):  # type: ignore[no-untyped-def]
    """From a y that keeps all bounds (row 4 of `y`), level by level to the best, by steps that never leave them: a primal active
    set (Nocedal and Wright 2006, §16.5) in what the levels above have left. y is the solution; the bounds at it are active.

    A bound that a level presses against is owned from then on, like the level's own directions; others go free again.
    """
    about, active = matrix(table, at.LEVEL), matrix(table, at.ACTIVE)
    here, there = line(table, at.VALUE, 1), line(table, at.VALUE, 0)
    y, met, chain = line(table, at.Y, 4), line(table, at.Y, 0), line(table, at.Y, 5)
    n, last, locked = sizes[at.N], sizes[at.LEVELS], 0
    sizes[at.ACTIVE_COUNT] = 0
    copy(y, met)
    _evaluate(table, plan, sizes, met, here)
    copy(line(table, at.Y, 3), chain)
    before, whole_before = fixed, fixed
    for level in range(1, last + 1):
        about[at.FREE_LEFT, level] = n - whole_before
        if level < last:
            about[at.LEAST, level], about[at.FILTERED, level] = 1.0, 0.0
            if sizes[at.READY] <= level:
                _ready_level(table, plan, support, roots, levels, sizes, level)
                sizes[at.READY] = level + 1
            if whole_before >= n:
                about[at.LEAST, level] = 0.0
                continue
            if levels[level, 3] == 0:
                continue
        elif whole_before >= n:
            break
        count, whole, finished = before, whole_before, False
        for _ in range(4 * n + 4):
            copy(chain, met)
            count = before
            for a in range(locked, sizes[at.ACTIVE_COUNT]):
                count = _meet_bound(table, sizes, a, count, met)
            until, whole = count, whole_before + count - before
            if level < last:
                if whole < n:
                    count, whole = _meet_level(table, levels, sizes, level, count, whole, met)
            elif whole < n:
                _meet_rest(table, sizes, count, met)
            sizes[at.PASSES] += 1
            _evaluate(table, plan, sizes, met, there)
            blocker, side, share = _first_in_the_way(table, sizes, bounds, here, there)
            for j in range(n):
                y[j] += share * (met[j] - y[j])
            for i in range(here.shape[0]):
                here[i] += share * (there[i] - here[i])
            if blocker >= 0:
                known = False
                for a in range(sizes[at.ACTIVE_COUNT]):
                    known = known or bounds[a, 0] == blocker
                # One that is active and yet broken all but depends on others: no step beyond it can be trusted.
                if known or sizes[at.ACTIVE_COUNT] >= n:
                    break
                _activate(table, plan, sizes, bounds, sizes[at.ACTIVE_COUNT], blocker, side)
                sizes[at.ACTIVE_COUNT] += 1
                continue
            for a in range(locked, sizes[at.ACTIVE_COUNT]):
                active[2, a] = 0.0
            worst = _multipliers(table, levels, sizes, level, before, until, met)
            if worst < 0:
                finished = True
                break
            _drop(table, sizes, bounds, worst)
        if level == last:
            break
        if finished:
            a, dropped, least = locked, False, _damping_presses(table, levels, sizes, level, y)
            while a < sizes[at.ACTIVE_COUNT]:
                if active[2, a] > least:
                    a += 1
                else:
                    active_left = sizes[at.ACTIVE_COUNT] - 1
                    for b in range(a, active_left):
                        active[2, b] = active[2, b + 1]
                    _drop(table, sizes, bounds, a)
                    dropped = True
            if dropped:
                copy(chain, met)
                count = before
                for a in range(locked, sizes[at.ACTIVE_COUNT]):
                    count = _meet_bound(table, sizes, a, count, met)
                whole = whole_before + count - before
                if whole < n:
                    count, whole = _meet_level(table, levels, sizes, level, count, whole, met)
            # With damping, what is let go here is not what the level can do without: only what lies below may leave it.
            copy(met if vector(table, at.SETTINGS)[at.DAMPING] == 0.0 else y, chain)
        else:  # out of steps: what is reached stands, and is kept
            copy(y, chain)
        locked, before, whole_before = sizes[at.ACTIVE_COUNT], count, whole
    copy(y, met)
    about[at.FREE_LEFT, last] = n - whole_before
    _evaluate(table, plan, sizes, met, there)


@njit(fastmath=FAST, error_model="numpy")
def _evaluate(table, plan, sizes, y, value):  # type: ignore[no-untyped-def]
    """q̈, torques, bounded rows of a y into `value`; forces into `out`."""
    low, out, bias = matrix(table, at.FACTOR), matrix(table, at.OUT), vector(table, at.BIAS)
    force, bounded, scale = matrix(table, at.FORCE_ROWS), matrix(table, at.BOUNDED), vector(table, at.FORCE_SCALES)
    nv, nf = sizes[at.NV], sizes[at.NF]
    torque = value[nv : 2 * nv]
    for i in range(nv):
        torque[i] = bias[i]
    for i in range(nv):
        factor = low[i]
        s = y[i]
        for j in range(i):
            s -= factor[j] * value[j]
        value[i] = s / factor[i]
        for j in range(i + 1):
            torque[j] += factor[j] * y[i]
    for c in range(nf):
        f = scale[c] * y[nv + c]
        out[2, c] = f
        row = force[c]
        for j in range(nv):
            torque[j] -= f * row[j]
    for k in range(sizes[at.TASKS]):  # what a follower's drive would have to do, its leader's does
        if plan[k, at.KIND] == at.TRANSMISSION_KIND and plan[k, at.SLOT] == 1 and plan[k, at.ON]:
            leader, follower = plan[k, at.JOINT], plan[k, at.BASE_JOINT]
            torque[leader] += matrix(table, at.PARAMETERS)[k, at.EXTRA] * torque[follower]
            torque[follower] = 0.0
    for r in range(sizes[at.BOUNDED_ROWS]):
        row = bounded[r]
        s = _dot(row, value, nv)
        for c in range(nf):
            s += row[nv + c] * out[2, c]
        value[2 * nv + r] = s


@njit(fastmath=FAST, error_model="numpy")
def bound_row(table, plan, sizes, number, row):  # type: ignore[no-untyped-def]
    """The row of x of a bound; returns the constant that the value has beside row · x."""
    nv = sizes[at.NV]
    fill(row, 0.0)
    if number < nv:
        row[number] = 1.0
        return 0.0
    if number >= 2 * nv:
        copy(line(table, at.BOUNDED, number - 2 * nv), row)
        return 0.0
    i = number - nv
    constant = _torque_row(table, sizes, i, 1.0, row)
    for k in range(sizes[at.TASKS]):
        transmission = plan[k, at.KIND] == at.TRANSMISSION_KIND and plan[k, at.SLOT] == 1 and plan[k, at.ON]
        if transmission and plan[k, at.JOINT] == i:
            ratio = matrix(table, at.PARAMETERS)[k, at.EXTRA]
            constant += _torque_row(table, sizes, plan[k, at.BASE_JOINT], ratio, row)
    return constant


@njit(fastmath=FAST, error_model="numpy")
def _torque_row(table, sizes, i, factor, row):  # type: ignore[no-untyped-def]
    mass, force, nv = matrix(table, at.MASS), matrix(table, at.FORCE_ROWS), sizes[at.NV]
    for j in range(nv):
        row[j] += factor * (mass[i, j] if j <= i else mass[j, i])
    for c in range(sizes[at.NF]):
        row[nv + c] -= factor * force[c, i]
    return factor * vector(table, at.BIAS)[i]


@njit(fastmath=FAST, error_model="numpy")
def _activate(table, plan, sizes, bounds, a, number, side):  # type: ignore[no-untyped-def]
    """Bound `number` becomes active bound a, at its lower (−1) or upper (1) side. Its row points out of what is allowed."""
    active_row, active = matrix(table, at.ACTIVE_ROW), matrix(table, at.ACTIVE)
    row = active_row[a]
    constant = bound_row(table, plan, sizes, number, row)
    length = _unit(matrix(table, at.FACTOR), row, vector(table, at.FORCE_SCALES))
    limit = matrix(table, at.BOUND)[0 if side < 0 else 1, number] - constant
    if side < 0:
        for j in range(row.shape[0]):
            row[j] = -row[j]
    active[0, a] = side * limit / length if length > 0.0 else 0.0
    active[1, a] = length
    bounds[a, 0], bounds[a, 1] = number, side


@njit(fastmath=FAST, error_model="numpy")
def _drop(table, sizes, bounds, a):  # type: ignore[no-untyped-def]
    active_row, active = matrix(table, at.ACTIVE_ROW), matrix(table, at.ACTIVE)
    last = sizes[at.ACTIVE_COUNT] - 1
    for i in range(a, last):
        copy(active_row[i + 1], active_row[i])
        active[0, i], active[1, i] = active[0, i + 1], active[1, i + 1]
        bounds[i, 0], bounds[i, 1] = bounds[i + 1, 0], bounds[i + 1, 1]
    sizes[at.ACTIVE_COUNT] = last


@njit(fastmath=FAST, error_model="numpy")
def _let_go(table, levels, sizes, bounds, fixed):  # type: ignore[no-untyped-def]
    """Drop active bounds that a level would be better without. Returns how many were.

    A bound is rightly active when the first of its multipliers over the levels that is not zero presses against it (Escande,
    Mansard and Wieber 2014, §4).
    """
    active, about, y = matrix(table, at.ACTIVE), matrix(table, at.LEVEL), line(table, at.Y, 0)
    count, dropped = sizes[at.ACTIVE_COUNT], 0
    for a in range(count):
        active[3, a] = 0.0
    for level in range(1, sizes[at.LEVELS] + 1):
        for a in range(count):
            active[2, a] = 0.0
        _multipliers(table, levels, sizes, level, fixed, int(about[at.LEVEL_HEIGHT, level]), y)
        least = _damping_presses(table, levels, sizes, level, y)
        for a in range(count - 1, -1, -1):
            if active[3, a] == 0.0 and not 0.0 < active[2, a] <= least:
                active[3, a] = active[2, a]
            if active[3, a] < 0.0:
                _drop(table, sizes, bounds, a)
                dropped += 1
        if dropped:
            return dropped
    return 0


@njit(fastmath=FAST, error_model="numpy")
def _take_in(table, plan, sizes, bounds, value):  # type: ignore[no-untyped-def]
    """Make bounds active that the solution breaks. Returns how many there are, −1 when one is active already and yet broken."""
    bound, n = matrix(table, at.BOUND), sizes[at.N]
    broken = 0
    total = 2 * sizes[at.NV] + sizes[at.BOUNDED_ROWS]
    for i in range(total):
        over = value[i] - bound[1, i]
        under = bound[0, i] - value[i]
        side, most = (1, over) if over > under else (-1, under)
        limit = bound[1, i] if side > 0 else bound[0, i]
        if not most > _ROW_TOLERANCE * (1.0 + abs(limit)):
            continue
        broken += 1
        for a in range(sizes[at.ACTIVE_COUNT]):
            if bounds[a, 0] == i:
                return -1
        if sizes[at.ACTIVE_COUNT] >= n:
            return -1
        _activate(table, plan, sizes, bounds, sizes[at.ACTIVE_COUNT], i, side)
        sizes[at.ACTIVE_COUNT] += 1
    return broken


@njit(fastmath=FAST, error_model="numpy")
def _keeps(table, sizes, value, tolerance):  # type: ignore[no-untyped-def]
    """All bounds hold."""
    bound = matrix(table, at.BOUND)
    for i in range(2 * sizes[at.NV] + sizes[at.BOUNDED_ROWS]):
        over = max(value[i] - bound[1, i], bound[0, i] - value[i])
        limit = min(abs(bound[0, i]), abs(bound[1, i]))
        if over > tolerance * (1.0 + limit):
            return False
    return True


@njit(fastmath=FAST, error_model="numpy")
def _write_out(table, sizes):  # type: ignore[no-untyped-def]
    out, value, nv = matrix(table, at.OUT), line(table, at.VALUE, 0), sizes[at.NV]
    for i in range(nv):
        out[0, i], out[1, i] = value[i], value[nv + i]


@njit(fastmath=FAST, error_model="numpy")
def _joint_bounds(table, sizes):  # type: ignore[no-untyped-def]
    """Bounds of q̈ and torque from the joints' limits; see constraints.JointLimits."""
    bound, limits, state = matrix(table, at.BOUND), matrix(table, at.LIMITS), matrix(table, at.STATE)
    nv = sizes[at.NV]
    for i in range(nv):
        q, v, rate = state[0, i], state[1, i], limits[5, i]
        most = limits[3, i]
        up = min(rate * rate * (limits[1, i] - q) - 2.0 * rate * v, rate * (limits[2, i] - v))
        down = max(rate * rate * (limits[0, i] - q) - 2.0 * rate * v, -rate * (limits[2, i] + v))
        up, down = min(max(up, -most), most), max(min(down, most), -most)
        if down > up:  # it has to brake for both ends at once: the end is what it must not pass
            up = down = 0.5 * (up + down)
        bound[0, i], bound[1, i] = down, up
        bound[0, nv + i], bound[1, nv + i] = -limits[4, i], limits[4, i]


@njit(fastmath=FAST, error_model="numpy")
def _finite(row):  # type: ignore[no-untyped-def]
    s = 0.0
    for i in range(row.shape[0]):
        s += 0.0 * row[i]
    return s == 0.0


@njit(fastmath=FAST, error_model="numpy")
def _prepare(table, plan, support, roots, levels, sizes):  # type: ignore[no-untyped-def]
    """All but the walk: factor, forces, bounds, equalities. Returns (status, directions that the equalities own)."""
    state = matrix(table, at.STATE)
    sizes[at.READY], sizes[at.PASSES], sizes[at.CULPRIT] = 1, 0, -1
    low = matrix(table, at.FACTOR)
    nv, tasks = sizes[at.NV], sizes[at.TASKS]
    if not (_finite(state[0]) and _finite(state[1]) and _finite(vector(table, at.BIAS))):
        return at.NOT_FINITE, 0
    if not _factor(matrix(table, at.MASS), low):
        return at.NOT_FINITE, 0
    if sizes[at.NF]:
        force_rows(table, plan, support, tasks)
        _force_scales(table, plan, sizes, vector(table, at.FORCE_SCALES))
    _joint_bounds(table, sizes)
    bound = matrix(table, at.BOUND)
    for k in range(levels[sizes[at.LEVELS], 0], tasks):
        if plan[k, at.ON]:
            bounded_rows(table, plan, support, roots, nv, k, bound[0, 2 * nv :], bound[1, 2 * nv :])
        else:
            for i in range(plan[k, at.FIRST], plan[k, at.FIRST] + plan[k, at.COUNT]):
                bound[0, 2 * nv + i], bound[1, 2 * nv + i] = -np.inf, np.inf
    fixed = 0
    if sizes[at.EQUALITIES]:
        raw, known, bias = matrix(table, at.RAW), matrix(table, at.ROW), vector(table, at.BIAS)
        scale = vector(table, at.FORCE_SCALES)
        for i in range(sizes[at.BASE]):  # a free base has no drives: M q̈ + h − Jᵀ f = 0 in its rows
            fill(raw[i], 0.0)
            _torque_row(table, sizes, i, 1.0, raw[i])
            known[at.LENGTH, i] = _unit(low, raw[i], scale)
            known[at.WANTED, i] = -bias[i] / known[at.LENGTH, i]
        _ready_level(table, plan, support, roots, levels, sizes, 0)
        fixed = _equalities(table, levels, sizes)
        if fixed < 0:
            return at.CONTRADICTION, 0
    else:
        fill(line(table, at.Y, 3), 0.0)
    target, trial = vector(table, at.POSTURE_TARGET), line(table, at.Y, 1)
    fill(target, 0.0)
    posture = sizes[at.POSTURE_TASK]
    if posture >= 0 and plan[posture, at.ON]:
        posture_accelerations(table, plan[posture, at.SLOT], trial)
        for i in range(nv):
            target[i] = _dot(low[i], trial, i + 1)
    sizes[at.FIXED] = fixed
    return at.SOLVED, fixed


@njit(fastmath=FAST, error_model="numpy")
def _damp(table, sizes):  # type: ignore[no-untyped-def]
    """The damping of the next cycle: it comes up while a level is singular or a bound is active."""
    settings, about = vector(table, at.SETTINGS), matrix(table, at.LEVEL)
    most, now = settings[at.MOST_DAMPING], settings[at.DAMPING]
    weak = sizes[at.ACTIVE_COUNT] > 0
    for level in range(1, sizes[at.LEVELS]):
        weak = weak or about[at.FILTERED, level] > 0.0
    settings[at.DAMPING] = min(most, now + most / RISE) if weak else max(0.0, now - most / FALL)


@compiled(fastmath=FAST, error_model="numpy")
def solve(table, plan, support, roots, levels, sizes, bounds):  # type: ignore[no-untyped-def]
    """A whole cycle, from pinocchio's memory to q̈, torques and forces in `out`. Returns a layout.Status.

    `bounds` (n, 2) int64: which bounds are active, and at which side; the first ACTIVE_COUNT are where the search starts.
    """
    status, fixed = _prepare(table, plan, support, roots, levels, sizes)
    if status != at.SOLVED:
        sizes[at.ACTIVE_COUNT] = 0
        return status
    y, value, nv = line(table, at.Y, 0), line(table, at.VALUE, 0), sizes[at.NV]
    for a in range(sizes[at.ACTIVE_COUNT]):
        _activate(table, plan, sizes, bounds, a, bounds[a, 0], bounds[a, 1])
    a = 0
    while a < sizes[at.ACTIVE_COUNT]:
        if abs(matrix(table, at.ACTIVE)[0, a]) < np.inf:
            a += 1
        else:
            _drop(table, sizes, bounds, a)
    inside = False
    for _ in range(WALKS):
        active = sizes[at.ACTIVE_COUNT] > 0
        _walk(table, plan, support, roots, levels, sizes, fixed, active)
        _evaluate(table, plan, sizes, y, value)
        if not _finite(value[: 2 * nv]):
            sizes[at.ACTIVE_COUNT] = 0
            return at.NOT_FINITE
        broken = _take_in(table, plan, sizes, bounds, value)
        if broken < 0:
            break
        if broken:
            continue
        if not active or not _let_go(table, levels, sizes, bounds, fixed):
            _write_out(table, sizes)
            _damp(table, sizes)
            return at.SOLVED
        inside = True
        copy(y, line(table, at.Y, 4))
    if not inside:  # the equalities' own solution: standing still, more or less
        copy(line(table, at.Y, 3), line(table, at.Y, 4))
        _evaluate(table, plan, sizes, line(table, at.Y, 4), value)
        if not _keeps(table, sizes, value, _ROW_TOLERANCE):
            return at.SEARCHING
    _descend(table, plan, support, roots, levels, sizes, bounds, fixed)
    _write_out(table, sizes)
    _damp(table, sizes)
    return at.SOLVED if _keeps(table, sizes, value, 10.0 * _ROUNDING) else at.SEARCHING


@compiled(fastmath=FAST, error_model="numpy")
def descend(table, plan, support, roots, levels, sizes, bounds):  # type: ignore[no-untyped-def]
    """As `solve`, from a y in row 4 of `y` that keeps the bounds which stand there, as `solve` left them or somebody moved them."""
    fixed = sizes[at.FIXED]
    _descend(table, plan, support, roots, levels, sizes, bounds, fixed)
    _write_out(table, sizes)
    return at.SOLVED if _keeps(table, sizes, line(table, at.VALUE, 0), 10.0 * _ROUNDING) else at.SEARCHING


@compiled(fastmath=FAST, error_model="numpy")
def all_bound_rows(table, plan, sizes, rows, about):  # type: ignore[no-untyped-def]
    """Rows of y of all bounds, of unit length; about (2, m): the constant beside row · x, the length it had."""
    low, scale = matrix(table, at.FACTOR), vector(table, at.FORCE_SCALES)
    for i in range(rows.shape[0]):
        about[0, i] = bound_row(table, plan, sizes, i, rows[i])
        about[1, i] = _unit(low, rows[i], scale)
