"""The compositional translation, and where it gives way to the general form.

The formula of a part with what must come strictly after it (`after`) is built from those of its parts:

    event              p & X[!] after                          scattered: F(p & X[!] after)
    choice             the disjunction
    sequence           from the last part to the first, each with the next as its `after`
    AND, VOT           scattered: conjunction and threshold, where no event can serve two of the parts;
                       strict and projected: a window over single events, where no event can serve two of them
    otherwise          the general sum over what may come next
"""

from collections.abc import Callable, Sequence

from backends.ltlf.formulas import FALSE, TRUE
from backends.ltlf.orders import Orders, State
from backends.ltlf.parts import Op
from backends.ltlf.positions import Positions
from backends.ltlf.shape import Shape, disjoint_events, entangled, rivals_apart, tangled
from backends.ltlf.sharing import separable
from backends.ltlf.sums import total
from backends.ltlf.terms import Terms
from backends.ltlf.trampoline import Call, run
from backends.ltlf.windows import window


class Composer:
    """Translates the parts of one shape; `event_of` gives the formula of an EVENT part. `limit` bounds states and scenarios."""

    def __init__(self, shape: Shape, positions: Positions, event_of: Callable[[int], int], *, limit: int) -> None:
        self._shape = shape
        self._positions = positions
        self._formulas = positions.formulas
        self._event_of = event_of
        self._known: dict[tuple[int, int], int] = {}
        self._free: set[int] = set()
        """Parts below a separable one: they are translated one by one although they share occurrences."""
        self._tangled = tangled(shape)
        self._terms = Terms(limit)
        self._term: dict[int, int] = {}
        self._orders = Orders(shape.rows, monotone=positions.monotone, limit=limit)
        self._states: dict[int, State] = {}

    def whole(self) -> int:
        """The formula of the root, from the first position on."""
        return self._positions.begin(run(self._of(self._shape.root, TRUE)))

    def _of(self, part: int, after: int) -> Call[int]:
        key = (part, after)
        if key not in self._known:
            self._known[key] = yield self._made(part, after)
        return self._known[key]

    def _made(self, part: int, after: int) -> Call[int]:
        row = self._shape.rows[part]
        found: int
        if after == FALSE:
            return FALSE
        if part not in self._free and entangled(self._shape, part):
            if not self._positions.monotone or not separable(self._shape, part):
                found = yield self._sum_of_orders(part, after)
                return found
            self._set_free(part)
        match row.op:
            case Op.EVENT:
                return self._positions.step(self._event_of(part), after)
            case Op.ONE:
                return self._formulas.disjunction((yield self._each(row.parts, after)))
            case Op.SEQUENCE:
                for inner in reversed(row.parts):
                    after = yield self._of(inner, after)
                return after
            case Op.ALL | Op.AT_LEAST if not row.parts:
                return after
            case Op.ALL | Op.AT_LEAST if self._positions.monotone:
                found = yield self._anywhere(part, after)
                return found
            case Op.ALL | Op.AT_LEAST:
                found = yield self._in_place(part, after)
                return found

    def _set_free(self, part: int) -> None:
        todo = [part]
        while todo:
            number = todo.pop()
            if number not in self._free:
                self._free.add(number)
                todo.extend(self._shape.rows[number].parts)

    def _each(self, parts: Sequence[int], after: int) -> Call[list[int]]:
        found: list[int] = []
        for inner in parts:
            found += [(yield self._of(inner, after))]
        return found

    def _anywhere(self, part: int, after: int) -> Call[int]:
        """AND and VOT under `scattered`."""
        row = self._shape.rows[part]
        if row.op is Op.AT_LEAST:
            if not rivals_apart(self._shape, part):
                threshold: int = yield self._sum([part], part, after)
                return threshold
            return self._threshold((yield self._each(row.parts, after)), row.need)
        found = []
        apart = rivals_apart(self._shape, part)
        groups = [[inner] for inner in row.parts] if apart else self._rival_groups(row.parts)
        for group in groups:
            if len(group) == 1:
                found.append((yield self._of(group[0], after)))
            else:
                found.append((yield self._sum(group, part, after)))
        return self._formulas.conjunction(found)

    def _threshold(self, parts: Sequence[int], need: int) -> int:
        """At least `need` of the formulas: T(i, j) = f_i & T(i+1, j-1) | T(i+1, j)."""
        f = self._formulas
        row = [TRUE] + [FALSE] * need
        for formula in reversed(parts):
            row = [TRUE] + [
                f.disjunction([f.conjunction([formula, row[count - 1]]), row[count]]) for count in range(1, need + 1)
            ]
        return row[need]

    def _rival_groups(self, parts: Sequence[int]) -> list[list[int]]:
        """The parts, those together of which one event may serve two."""
        groups: list[tuple[list[int], int, int]] = []
        for part in parts:
            members, events, rivals = [part], self._shape.events[part], self._shape.rivals[part]
            apart = []
            for group in groups:
                if group[2] & events:
                    members, events, rivals = [*group[0], *members], events | group[1], rivals | group[2]
                else:
                    apart.append(group)
            groups = [*apart, (members, events, rivals)]
        return [members for members, _, _ in groups]

    def _in_place(self, part: int, after: int) -> Call[int]:
        """AND and VOT under `strict` and `projected`."""
        row = self._shape.rows[part]
        if not disjoint_events(self._shape, part):
            found: int = yield self._sum([part], part, after)
            return found
        need = row.need if row.op is Op.AT_LEAST else len(row.parts)
        return window(self._positions, [self._unit(inner) for inner in row.parts], need, after)

    def _unit(self, part: int) -> int:
        events = self._shape.unit[part]
        assert events is not None
        return self._formulas.disjunction(self._event_of(event) for event in events)

    def _term_of(self, part: int) -> int:
        todo = [part]
        while todo:
            number = todo[-1]
            row = self._shape.rows[number]
            missing = [inner for inner in row.parts if inner not in self._term]
            if missing:
                todo.extend(missing)
                continue
            todo.pop()
            if row.op is Op.EVENT:
                self._term[number] = self._terms.event(self._event_of(number))
            else:
                self._term[number] = self._terms.part(row, [self._term[inner] for inner in row.parts])
        return self._term[part]

    def _sum(self, some: Sequence[int], whole: int, after: int) -> Call[int]:
        """The general form of some parts of a whole in any order; where occurrences are shared below, of the whole."""
        if any(self._tangled[part] for part in some):
            return self._sum_of_orders(whole, after)
        return self._sum_of_terms([self._term_of(part) for part in some], after)

    def _sum_of_terms(self, terms: list[int], after: int) -> Call[int]:
        initial = self._terms.all_of(terms)
        return total(self._positions, initial, done=self._terms.over, steps=self._terms.steps, after=after)

    def _sum_of_orders(self, part: int, after: int) -> Call[int]:
        if part not in self._states:
            self._states[part] = self._orders.of(part)

        def steps(state: State) -> list[tuple[int, State]]:
            return [(self._event_of(event), following) for event, following in self._orders.steps(state)]

        return total(self._positions, self._states[part], done=self._orders.over, steps=steps, after=after)
