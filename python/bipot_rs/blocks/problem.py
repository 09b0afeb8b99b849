"""`assemble`: from rigid blocks to a reduced problem; `BlockProblem`, which knows its blocks."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from functools import partial
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from bipot_rs._lib.matrices import rigid_motions
from bipot_rs._lib.messages import count_noun, instead
from bipot_rs._lib.types import CsrMatrix, Floats, Ints
from bipot_rs._lib.validation import floats, integer, number, show_value
from bipot_rs.blocks.block import Block
from bipot_rs.blocks.interfaces import Interface, find_interfaces, refuse_overlap
from bipot_rs.contact.errors import (
    FloatingBodyError,
    NoEquilibriumError,
    NotConvergedError,
)
from bipot_rs.contact.law.frames import frames
from bipot_rs.contact.reduced import ReducedProblem

if TYPE_CHECKING:
    from bipot_rs._lib.types import CsrMatrix

# Parts of a motion below this, relative to the largest, are not described.
_WORTH = 1e-4
# Blocks that a description of a motion names.
_NAMED = 6


class InterfaceForce(NamedTuple):
    """What one interface transfers to its second block."""

    interface: int  # number of the interface
    force: Floats  # `(d,)`, in x, y[, z]
    # Centre of pressure, `(d,)`: where the force acts, but for a moment about it.
    point: Floats


class BlockProblem(ReducedProblem):
    """Rigid blocks held by contact alone, as a `ReducedProblem`; `assemble` makes it.

    ``v = W r + R a``, where ``a`` has the motions of each free block: translations along
    the axes, then rotations about its centre of mass. ``e`` has forces and moments in the
    same order.

    Attributes
    ----------
    blocks
        The blocks, supports included.
    interfaces
        The interfaces between them.
    points, frame
        Coordinates ``(n_c, d)`` and bases ``(n_c, d, d)`` of the contacts; rows n, t1[, t2],
        the normal from the first block of the interface to the second.
    interface
        Number of the interface of each contact, ``(n_c,)``.
    free
        Numbers of the blocks that can move, in the order of ``a``.
    """

    rigid: tuple[CsrMatrix, Floats]

    def __init__(
        self,
        blocks: Sequence[Block],
        interfaces: Sequence[Interface],
        mu: ArrayLike,
        gravity: Floats,
        stiffness: tuple[float, float] | None,
    ) -> None:
        self.blocks = tuple(blocks)
        self.interfaces = tuple(interfaces)
        self.free = tuple(k for k, block in enumerate(blocks) if not block.support)
        self._rebuild = partial(
            BlockProblem, self.blocks, self.interfaces, mu, gravity, stiffness
        )
        self.points: Floats = np.concatenate([face.points for face in interfaces])
        counts = [len(face.points) for face in interfaces]
        self.interface: Ints = np.repeat(np.arange(len(counts)), counts)
        normals = np.array([face.normal for face in interfaces])
        self.frame: Floats = frames(normals)[self.interface]
        R = self._find_motions()
        share = np.array([face.area for face in interfaces]) / counts
        W = _make_compliance(share[self.interface], self.frame.shape[1], stiffness)
        super().__init__(
            W,
            np.zeros(self.points.shape),
            np.broadcast_to(np.asarray(mu, float), (len(counts),))[self.interface],
            rigid=(R, self.body_force(gravity)),
        )

    def __reduce__(self) -> tuple[object, ...]:
        return self._rebuild, ()

    def __repr__(self) -> str:
        return (
            f"BlockProblem({count_noun(len(self.blocks), 'block')}, "
            f"{count_noun(len(self.interfaces), 'interface')}, "
            f"{count_noun(len(self.points), 'contact')})"
        )

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the blocks."""
        return tuple(block.name for block in self.blocks)

    def body_force(self, acceleration: ArrayLike) -> Floats:
        """Loads ``e (k,)`` of density times volume times ``acceleration (d,)``."""
        d = self.points.shape[1]
        field = floats("acceleration", acceleration, shape=(d,))
        e = np.zeros((len(self.free), 3 * (d - 1)))
        for row, k in zip(e, self.free, strict=True):
            row[:d] = self.blocks[k].density * self.blocks[k].volume * field
        return e.ravel()

    def load(
        self, name: str, force: ArrayLike, point: ArrayLike | None = None
    ) -> Floats:
        """Loads ``e (k,)`` of one ``force (d,)`` on a block.

        Parameters
        ----------
        name
            The block; not a support.
        force
            ``(d,)``.
        point
            Where it acts, ``(d,)``. Default: the centre of mass.
        """
        number_of = _number_block(self.blocks, name)
        if number_of not in self.free:
            raise ValueError(f"block {name!r} is a support, and loads do not move it")
        d = self.points.shape[1]
        vector = floats("force", force, shape=(d,))
        centre = self.blocks[number_of].centre
        at = centre if point is None else floats("point", point, shape=(d,))
        e = np.zeros((len(self.free), 3 * (d - 1)))
        modes = rigid_motions((at - centre)[None])[0]
        e[self.free.index(number_of)] = vector @ modes
        return e.ravel()

    def moves(self, motion: ArrayLike) -> Floats:
        """Motion of each block ``(n, 3 (d - 1))``, zero for supports, from ``a (k,)``."""
        amounts = floats("motion", motion, shape=(self._motions,))
        d = self.points.shape[1]
        by_block = np.zeros((len(self.blocks), 3 * (d - 1)))
        by_block[list(self.free)] = amounts.reshape(len(self.free), -1)
        return by_block

    def move(self, k: int, points: Floats, motion: Floats) -> Floats:
        """Displacement ``(n, d)`` of points of block ``k`` in a row of `moves`."""
        return rigid_motions(points - self.blocks[k].centre) @ motion

    def resultants(self, reaction: ArrayLike) -> list[InterfaceForce]:
        """Force and centre of pressure of each interface that carries a force."""
        r = floats("reaction", reaction, shape=self.q.shape)
        force = np.einsum("cd,cde->ce", r, self.frame)
        loaded = []
        for k in range(len(self.interfaces)):
            at = self.interface == k
            normal = np.maximum(r[at, 0], 0.0)
            if normal.sum() > 0:
                point = normal @ self.points[at] / normal.sum()
                loaded.append(InterfaceForce(k, force[at].sum(axis=0), point))
        return loaded

    def normal_range(self, interface: int) -> tuple[float, float]:
        """Least and largest normal force of an interface, for rigid joints.

        Over all reactions in the friction cones that balance the loads. The largest may be
        infinite: wedges can press on each other without loads.

        Parameters
        ----------
        interface
            Its number in ``interfaces``.

        Raises
        ------
        ValueError
            The joints have a stiffness.
        NoEquilibriumError, NotConvergedError
            No reactions balance the loads, or this was not decided.
        """
        from scipy.sparse import bmat, csr_array

        chosen = integer("interface", interface, least=0, most=len(self.interfaces) - 1)
        if self.W.nnz:
            raise ValueError(
                "the joints have a stiffness, which determines their forces"
            )
        equilibrium = self.equilibrium()
        if equilibrium.reaction is None:
            kind = (
                NoEquilibriumError
                if equilibrium.verdict == "none"
                else NotConvergedError
            )
            raise kind(equilibrium.reason)
        count, d = self.q.shape
        column = np.zeros(self.q.shape)
        column[self.interface == chosen, 0] = 1.0
        ceiling = float((column * equilibrium.reaction).sum())
        ceiling += float(np.abs(self.rigid[1]).sum())
        # One motion more, on which the normal force N works, and one contact s >= 0 more that
        # works on it: its balance is N - s = λ, or N + s = ceiling - λ.
        bounds = []
        for sign, load in ((-1.0, 0.0), (1.0, -ceiling)):
            slack = csr_array(([sign], ([0], [0])), (d, 1))
            sides = [[self.rigid[0], csr_array(column.reshape(-1, 1))], [None, slack]]
            dead = np.append(self.rigid[1], load)
            live = np.append(np.zeros(len(self.rigid[1])), sign)
            wider = ReducedProblem(
                csr_array((d * (count + 1), d * (count + 1))),
                np.zeros((count + 1, d)),
                np.append(self.mu, 0.0),
                rigid=(bmat(sides).tocsr(), dead),
            )
            bounds.append(wider.limit_multiplier(dead, live).upper)
        return max(ceiling - bounds[1], 0.0), bounds[0]

    def describe(self, motion: ArrayLike) -> str:
        """Describe a motion ``a (k,)`` in words, the blocks that move most first.

        Scaled so that the largest displacement of a corner of a block is 1.
        """
        by_block = self.moves(motion)
        largest = np.array(
            [
                np.linalg.norm(self.move(k, block.points, row), axis=1).max()
                for k, (block, row) in enumerate(
                    zip(self.blocks, by_block, strict=True)
                )
            ]
        )
        if not largest.any():
            return "nothing moves"
        order = np.argsort(-np.round(largest / largest.max(), 4), kind="stable")
        moved = [k for k in order.tolist() if largest[k] > _WORTH * largest.max()]
        words = [
            f"block {self.blocks[k].name!r} {self._describe_move(k, by_block[k] / largest.max())}"
            for k in moved[:_NAMED]
        ]
        if len(moved) > _NAMED:
            words.append(f"{count_noun(len(moved) - _NAMED, 'block')} move less")
        return (
            " while ".join([words[0], ", ".join(words[1:])]) if words[1:] else words[0]
        )

    def _describe_move(self, k: int, motion: Floats) -> str:
        d = self.points.shape[1]
        shift, turn = motion[:d], motion[d:]
        size = self.blocks[k].size
        words = []
        for axis, amount in zip("xyz", shift, strict=False):
            if abs(amount) > _WORTH:
                upright = axis == "xyz"[d - 1]
                way = (
                    ("up by" if amount > 0 else "down by")
                    if upright
                    else f"along {axis} by"
                )
                shown = abs(amount) if upright else amount
                words.append(f"{way} {shown:.3g}")
        phrases = [f"moves {' and '.join(words)}"] if words else []
        rate = float(np.linalg.norm(turn))
        if rate * size > _WORTH:
            if d == 2:
                phrases.append(f"turns by {turn[0]:.3g}")
            else:
                axis = ", ".join(
                    f"{0.0 if abs(x) < _WORTH else x:.3g}" for x in turn / rate
                )
                phrases.append(f"turns by {rate:.3g} about ({axis})")
        return " and ".join(phrases)

    def _describe_amounts(self, amounts: Floats) -> str:
        return self.describe(amounts)

    def _describe_motion(self, amounts: Floats, direction: Floats, mu: Floats) -> str:  # noqa: ARG002
        return self.describe(amounts)

    def _find_motions(self) -> CsrMatrix:
        """R, sparse: motion of the second block minus that of the first, in the frames."""
        from scipy.sparse import coo_array

        count, d = self.points.shape
        modes = 3 * (d - 1)
        column_of = {k: modes * place for place, k in enumerate(self.free)}
        owner = np.array([(face.first, face.second) for face in self.interfaces])
        data, row, column = [], [], []
        for sign, side in zip((-1.0, 1.0), owner[self.interface].T, strict=True):
            at = np.flatnonzero(np.isin(side, self.free))
            centre = np.array([block.centre for block in self.blocks])[side[at]]
            moved = sign * self.frame[at] @ rigid_motions(self.points[at] - centre)
            first = np.array([column_of[k] for k in side[at].tolist()], np.int64)
            rows, columns = d * at[:, None, None], first[:, None, None]
            data.append(moved.ravel())
            row.append(
                np.broadcast_to(rows + np.arange(d)[:, None], moved.shape).ravel()
            )
            column.append(
                np.broadcast_to(columns + np.arange(modes), moved.shape).ravel()
            )
        entries = np.concatenate(data), (np.concatenate(row), np.concatenate(column))
        R: CsrMatrix = coo_array(entries, (d * count, modes * len(self.free))).tocsr()
        R.eliminate_zeros()
        return R


def assemble(
    blocks: Sequence[Block],
    mu: float | Mapping[tuple[str, str], float],
    *,
    supports: Collection[str] = (),
    gravity: ArrayLike | None = None,
    interfaces: Sequence[Interface] | None = None,
    stiffness: tuple[float, float] | None = None,
    tolerance: float = 1e-4,
) -> BlockProblem:
    """Make the contact problem of rigid blocks that press on each other.

    Parameters
    ----------
    blocks
        The blocks, with different names.
    mu
        Friction coefficient, or that of each pair of blocks, by their names.
    supports
        Names of blocks that are held, besides those with ``support=True``. At least one
        block is held.
    gravity
        Acceleration ``(d,)``. Default: 1, downwards along the last axis, so that density is
        weight per volume.
    interfaces
        Where the blocks touch. Default: `find_interfaces`.
    stiffness
        Normal and tangential stiffness of the joints, per area and length. Default: rigid
        joints. Each corner has an equal share of the area of its interface.
    tolerance
        As in `find_interfaces`.

    Raises
    ------
    TypeError, ValueError
        An argument is wrong, no block is held, or blocks do not touch.
    FloatingBodyError
        A block touches no other block.

    Examples
    --------
    A block on an inclined plane of slope 0.4; it slides if μ is smaller:

    >>> import numpy as np
    >>> import bipot_rs as bp
    >>> blocks = [
    ...     bp.blocks.Block(
    ...         "ground", [[-5, -1], [5, -1], [5, 0], [-5, 0]], support=True
    ...     ),
    ...     bp.blocks.Block("stone", [[0, 0], [2, 0], [2, 1], [0, 1]]),
    ... ]
    >>> for mu in (0.5, 0.3):
    ...     problem = bp.blocks.assemble(blocks, mu, gravity=[0.4, -1.0])
    ...     print(problem.existence().verdict)
    guaranteed
    none
    """
    if not isinstance(blocks, Iterable):
        raise TypeError(f"blocks is {show_value(blocks)}, expected Blocks")
    blocks = list(blocks)
    for block in blocks:
        if not isinstance(block, Block):
            raise TypeError(f"blocks has a {type(block).__name__}, expected Blocks")
    names = [block.name for block in blocks]
    if len(set(names)) < len(names):
        twice = next(name for name in names if names.count(name) > 1)
        raise ValueError(f"two blocks have the name {twice!r}")
    if isinstance(supports, str) or not isinstance(supports, Collection):
        raise TypeError(f"supports is {show_value(supports)}, expected names of blocks")
    held = {_number_block(blocks, name) for name in supports}
    blocks = [_hold(block) if k in held else block for k, block in enumerate(blocks)]
    if not any(block.support for block in blocks):
        raise ValueError(
            "no block is a support, and nothing carries the loads: name the blocks that "
            "are held in supports"
        )
    if all(block.support for block in blocks):
        raise ValueError("all blocks are supports, and none can move")
    d = blocks[0].points.shape[1]
    if {block.points.shape[1] for block in blocks} != {d}:
        raise ValueError("some blocks lie in the plane and some in space")
    down = np.array([0.0] * (d - 1) + [-1.0])
    field = down if gravity is None else floats("gravity", gravity, shape=(d,))
    if interfaces is None:
        interfaces = find_interfaces(blocks, tolerance=number("tolerance", tolerance))
    refuse_overlap(blocks)
    between = [
        face
        for face in interfaces
        if not (blocks[face.first].support and blocks[face.second].support)
    ]
    touching = {k for face in between for k in (face.first, face.second)}
    for k, block in enumerate(blocks):
        if not block.support and k not in touching:
            raise FloatingBodyError(
                f"block {block.name!r} touches no other block: move it, or give a tolerance "
                f"larger than {tolerance:g}"
            )
    if stiffness is not None:
        normal, tangential = floats("stiffness", stiffness, shape=(2,)).tolist()
        if not (normal > 0 and tangential > 0):
            raise ValueError(
                f"stiffness is {show_value(stiffness)}, expected positive numbers"
            )
        stiffness = normal, tangential
    return BlockProblem(
        blocks, between, _read_friction(mu, blocks, between), field, stiffness
    )


def _number_block(blocks: Sequence[Block], name: str) -> int:
    names = [block.name for block in blocks]
    if name not in names:
        raise ValueError(f"there is no block {name!r}{instead(str(name), names)}")
    return names.index(name)


def _hold(block: Block) -> Block:
    return Block(
        block.name,
        block.points,
        None if block.points.shape[1] == 2 else block.faces,
        density=block.density,
        support=True,
    )


def _read_friction(
    mu: float | Mapping[tuple[str, str], float],
    blocks: Sequence[Block],
    interfaces: Sequence[Interface],
) -> Floats:
    """Friction coefficient of each interface."""
    if not isinstance(mu, Mapping):
        return np.full(len(interfaces), number("mu", mu))
    coefficients = []
    for face in interfaces:
        pair = blocks[face.first].name, blocks[face.second].name
        value = mu.get(pair, mu.get(pair[::-1]))
        if value is None:
            raise ValueError(
                f"mu has no number for the blocks {pair[0]!r} and {pair[1]!r}"
            )
        coefficients.append(number(f"mu of {pair}", value))
    return np.array(coefficients)


def _make_compliance(
    area: Floats, d: int, stiffness: tuple[float, float] | None
) -> CsrMatrix:
    """W, diagonal: of joints with a stiffness per area, else zero."""
    from scipy.sparse import csr_array

    from bipot_rs._lib.matrices import diagonal_matrix

    if stiffness is None:
        W: CsrMatrix = csr_array((d * len(area), d * len(area)))
        return W
    by_component = np.array([stiffness[0]] + [stiffness[1]] * (d - 1))
    return diagonal_matrix((1.0 / (area[:, None] * by_component)).ravel())
