/* @types */
/* A match, or an event of a leaf with `times`: the times and the numbers of its first and last events. */
typedef struct span {
    int64_t least;
    int64_t most;
    uint64_t first;
    uint64_t last;
    uint32_t before; /* in its front, or 0; numbers are places in the table, plus 1 */
    uint32_t next;   /* in its front, or the next free one */
#if RVAFT_PLACES
    uint32_t events;
#endif
} span;

typedef struct span_table {
    uint32_t count; /* with those that are free */
    uint32_t used;
    uint32_t spare;
    uint32_t sweep_at;
    span item[RVAFT_CAPACITY];
} span_table;

/* Matches of a node, none within another, in the order of their least times. */
typedef struct front {
    uint32_t head;
    uint32_t tail;
} front;

/* The last events of a leaf with `times` in the order of time (without a window, of the log). */
typedef struct ring {
    front events;
    uint32_t size;
    uint32_t in_turn; /* how many of the last ones came in their order, at most as many as are counted */
    uint32_t start;   /* the first of the last ones, as many as are counted, or 0 */
#if RVAFT_PLACES
    uint32_t links; /* of the chain of their events, with those that are not needed */
#endif
} ring;

/* What an instance keeps. */
typedef struct kept {
    front fronts[RVAFT_FRONTS];
    ring rings[RVAFT_RINGS];
} kept;

/* @members */
    span_table spans;

/* @rows */
enum { ROOT, ONLY, BESIDE, FIRST, AFTER };

/* How a match of a node completes the gate above: as its root, as ONLY one, with others BESIDE it, as the
   FIRST of a sequence, or AFTER those before it. */
typedef struct node {
    uint64_t within; /* the longest duration of a match in nanoseconds */
    uint64_t limit;  /* the least of `within` here and above */
    uint32_t unit;
    uint32_t gate;
    uint32_t place;  /* of its front in an instance; NONE if matches are not kept */
    uint32_t elder;  /* AFTER: the place of the front of the children before */
    uint32_t beside; /* BESIDE: the place of the front of the first child of the gate */
    uint32_t children;
    uint32_t need; /* the number of children that complete the gate */
    uint8_t how;
    uint8_t again;  /* whether a match that is not kept may complete the gate again */
    uint8_t inside; /* whether the first number of a match matters: in a later child of a sequence */
    uint8_t before; /* whether the last number of a match matters to the next child */
    uint8_t apart;  /* AFTER: whether a match must begin after the last event of those before it */
} node;

/* @kept */
/* Spans and fronts. */

static span *span_at(rvaft_monitor *m, uint32_t number) { return &ROW(m->spans.item, number - 1U); }

/* A new span, or 0 if there is no room. */
static uint32_t new_span(rvaft_monitor *m) {
    span_table *t = &m->spans;
    uint32_t number = t->spare;
    if (number != 0) {
        t->spare = span_at(m, number)->next;
    } else if (t->count < RVAFT_CAPACITY) {
        number = ++t->count;
    } else {
        m->error = RVAFT_FULL;
        return 0;
    }
    t->used++;
    return number;
}

/* Put a span into a front, behind another one, or (for 0) as the first. */
static void link_span(rvaft_monitor *m, front *f, uint32_t before, uint32_t number) {
    span *s = span_at(m, number);
    uint32_t next = before != 0 ? span_at(m, before)->next : f->head;
    s->before = before;
    s->next = next;
    if (before != 0) {
        span_at(m, before)->next = number;
    } else {
        f->head = number;
    }
    if (next != 0) {
        span_at(m, next)->before = number;
    } else {
        f->tail = number;
    }
}

/* Remove a span of a front; returns the next one. */
static uint32_t drop_span(rvaft_monitor *m, front *f, uint32_t number) {
    span_table *t = &m->spans;
    span *s = span_at(m, number);
    uint32_t next = s->next, before = s->before;
    if (before != 0) {
        span_at(m, before)->next = next;
    } else {
        f->head = next;
    }
    if (next != 0) {
        span_at(m, next)->before = before;
    } else {
        f->tail = before;
    }
#if RVAFT_PLACES
    release_events(m, s->events);
#endif
    s->next = t->spare;
    t->spare = number;
    t->used--;
    return next;
}

static void drop_front(rvaft_monitor *m, front *f) {
    while (f->head != 0) {
        (void)drop_span(m, f, f->head);
    }
}

/* Put a copy of a span into a front, behind another one; returns 0 if there is no room. */
static uint32_t copy_span(rvaft_monitor *m, front *f, uint32_t before, const span *from) {
    uint32_t number = new_span(m);
    if (number != 0) {
        span moved = *from;
        *span_at(m, number) = moved;
#if RVAFT_PLACES
        retain_events(m, moved.events);
#endif
        link_span(m, f, before, number);
    }
    return number;
}

/* Whether the time between two is longer than a duration. */
static int is_longer(int64_t from, int64_t to, uint64_t limit) {
    return to > from && (uint64_t)to - (uint64_t)from > limit;
}

/* Add a copy of a match to a front unless another one lies within it, and remove those that it lies within;
   returns its number, or 0 if it is not added. With `first`, one that begins at a lower number replaces none, and with
   `last`, none is replaced, as an earlier one has the lower last number. */
static uint32_t add_span(rvaft_monitor *m, front *f, const span *made, int first, int last) {
    uint32_t from = 0, before = f->tail, at; /* the first that starts as late, and the one before it */
    while (before != 0 && span_at(m, before)->least >= made->least) {
        from = before;
        before = span_at(m, before)->before;
    }
    for (at = from; at != 0; at = span_at(m, at)->next) {
        const span *other = span_at(m, at);
        if (other->most <= made->most && (!first || other->first >= made->first)) {
            return 0;
        }
        if ((!first && !last) || other->least > made->most) {
            break; /* the others end later */
        }
    }
    if (!last) {
        while (!first && from != 0 && span_at(m, from)->least == made->least && span_at(m, from)->most >= made->most) {
            from = drop_span(m, f, from);
        }
        while (before != 0 && span_at(m, before)->most >= made->most &&
               (!first || span_at(m, before)->first <= made->first)) {
            uint32_t earlier = span_at(m, before)->before;
            (void)drop_span(m, f, before);
            before = earlier;
        }
    }
    return copy_span(m, f, before, made);
}

/* Remove the matches of a front that start too early for later events. Of those that end before any later
   event the last one is the best (with `ends`). */
static void trim_front(rvaft_monitor *m, front *f, int64_t latest, uint64_t limit, int ends) {
    while (f->head != f->tail) {
        const span *s = span_at(m, f->head), *next = span_at(m, s->next);
        int over = ends && latest >= next->most && (uint64_t)latest - (uint64_t)next->most >= lateness();
        if (!over && !has_passed(latest, s->least, limit, 1)) {
            break;
        }
        (void)drop_span(m, f, f->head);
    }
}

/* The longest time that the events of a leaf may take. */
static uint64_t limit_of(const leaf *l) { return ROW(nodes, l->node).limit; }

/* Remove the first event of a leaf with `times`. */
static void drop_event(rvaft_monitor *m, ring *q) {
    q->start = q->start == q->events.head ? 0 : q->start; /* there are too few */
    (void)drop_span(m, &q->events, q->events.head);
    q->size--;
    q->in_turn = q->size == 0 ? 0 : q->in_turn;
}

static void trim_ring(rvaft_monitor *m, ring *q, int64_t latest, uint64_t limit) {
    while (q->events.head != 0 && has_passed(latest, span_at(m, q->events.head)->least, limit, 1)) {
        drop_event(m, q);
    }
}

/* Make empty what an instance keeps, whatever its memory has. */
static void forget_kept(kept *r) { memset(r, 0, sizeof *r); }

/* Release what an instance keeps. */
RVAFT_UNUSED static void drop_kept(rvaft_monitor *m, kept *r) {
    uint32_t i;
    for (i = 0; i < RVAFT_FRONTS; i++) {
        drop_front(m, &r->fronts[i]);
    }
    for (i = 0; i < RVAFT_RINGS; i++) {
        drop_front(m, &r->rings[i].events);
    }
    forget_kept(r);
}

/* Whether a match is kept at a place. */
static int is_kept(const kept *r, uint32_t at) { return ROW(r->fronts, at).head != 0; }

/* Add a match to the front of a node, which is not the root. */
static int keep_span(rvaft_monitor *m, kept *r, const node *n, const span *made) {
    const node *gate = &ROW(nodes, n->gate);
    front *f = &ROW(r->fronts, n->place);
    if (gate->limit == UINT64_MAX) {
        return f->head == 0 && copy_span(m, f, 0, made) != 0;
    }
    if (!add_span(m, f, made, gate->inside, n->before)) {
        return 0;
    }
    if (RVAFT_LATE >= 0 && m->has_latest) {
        trim_front(m, f, m->latest, gate->limit, !gate->inside && !n->before);
    }
    return 1;
}

/* Remove what no later event can complete from what an instance of a kind keeps. */
static void trim_kept(rvaft_monitor *m, kept *r, uint32_t number, int64_t latest) {
    uint32_t i;
    for (i = 0; i < RVAFT_NODES; i++) {
        const node *n = &ROW(nodes, i), *gate = &ROW(nodes, n->gate);
        if (n->place != NONE && n->unit == number && gate->limit != UINT64_MAX) {
            trim_front(m, &ROW(r->fronts, n->place), latest, gate->limit, !gate->inside && !n->before);
        }
    }
    for (i = 0; i < RVAFT_LEAVES; i++) {
        const leaf *l = &leaves[i];
        if (l->count > 1 && l->kind == number && limit_of(l) != UINT64_MAX) {
            trim_ring(m, &ROW(r->rings, l->ring), latest, limit_of(l));
        }
    }
}

static void begin_kept(rvaft_monitor *m) {
    m->spans.count = 0;
    m->spans.used = 0;
    m->spans.spare = 0;
    m->spans.sweep_at = RVAFT_CAPACITY / 2 < FEW ? RVAFT_CAPACITY / 2 : FEW;
}

/* Whether what is not needed should be removed: there are twice as many spans as after the last time. */
static int is_crowded(const rvaft_monitor *m) { return m->spans.used > m->spans.sweep_at; }

RVAFT_UNUSED static int has_little_room(const rvaft_monitor *m) {
    return m->spans.used > RVAFT_CAPACITY - RVAFT_CAPACITY / 8;
}

static void set_crowded(rvaft_monitor *m) {
    uint32_t used = m->spans.used, free_spans = RVAFT_CAPACITY - used;
    m->spans.sweep_at = used + (used < free_spans / 2 ? (used < FEW ? FEW : used) : free_spans / 2);
}

/* @steps */
/* Joins. */

/* Extend a match by the events of another one, but not by their places. */
static void extend(span *s, const span *other) {
    s->least = other->least < s->least ? other->least : s->least;
    s->most = other->most > s->most ? other->most : s->most;
    s->first = other->first < s->first ? other->first : s->first;
    s->last = other->last > s->last ? other->last : s->last;
}

#if RVAFT_PLACES
/* Add the places of another match to those of a span. */
static void add_places(rvaft_monitor *m, uint32_t number, uint32_t events) {
    span *s = span_at(m, number);
    uint32_t all = joined_events(m, events, s->events);
    release_events(m, s->events);
    s->events = all;
}
#endif

/* Join two matches within a duration, and add the whole to a front. */
static void add_joined(rvaft_monitor *m, front *to, const span *s, const span *other, uint64_t limit, int first) {
    span made = *s;
    uint32_t number;
    extend(&made, other);
    if (limit == UINT64_MAX ? to->head != 0 : is_longer(made.least, made.most, limit)) {
        return;
    }
    number = add_span(m, to, &made, first, 0);
    (void)number;
#if RVAFT_PLACES
    if (number != 0) {
        add_places(m, number, other->events);
    }
#endif
}

/* Join a match with those of a front with which it may be joined best, and add the wholes to another front.
   With `apart`, those of the front have to end before it begins. */
static void join_front(rvaft_monitor *m, front *to, const front *others, const span *s, const node *gate, int apart) {
    const uint64_t limit = gate->limit;
    uint32_t at = others->tail;
    if (limit == UINT64_MAX) {
        if (others->head != 0) {
            add_joined(m, to, s, span_at(m, others->head), limit, 0);
        }
        return;
    }
    if (gate->inside || apart) {
        for (; at != 0 && m->error == 0; at = span_at(m, at)->before) {
            const span *other = span_at(m, at);
            if (is_longer(other->least, s->most, limit)) {
                return; /* the others start earlier */
            }
            if (!is_longer(s->least, other->most, limit) && (!apart || other->last < s->first)) {
                add_joined(m, to, s, other, limit, gate->inside);
                if (!gate->inside && other->most <= s->most) {
                    return;
                }
            }
        }
        return;
    }
    while (at != 0 && span_at(m, at)->most > s->most && span_at(m, at)->before != 0) {
        at = span_at(m, at)->before;
    }
    for (; at != 0 && m->error == 0; at = span_at(m, at)->next) { /* from the last that ends as early */
        add_joined(m, to, s, span_at(m, at), limit, 0);
        if (span_at(m, at)->least >= s->least) {
            return;
        }
    }
}

/* Join each match of a front with those of another one. */
static void join_each(rvaft_monitor *m, front *made, const front *others, const node *gate, int apart) {
    front joined = {0, 0};
    uint32_t at;
    for (at = made->head; at != 0 && m->error == 0; at = span_at(m, at)->next) {
        join_front(m, &joined, others, span_at(m, at), gate, apart);
    }
    drop_front(m, made);
    *made = joined;
}

/* The front of a sibling with a number, or NULL if it is that of the node, or is empty. */
static const front *sibling(const kept *r, const node *n, uint32_t number) {
    const front *f = &ROW(r->fronts, n->beside + number);
    return n->beside + number == n->place || f->head == 0 ? NULL : f;
}

/* Join a match with matches of as many siblings as are needed: for each time by which the whole may end, the latest
   first, those that start last. Only its times matter. */
static void join_best(rvaft_monitor *m, const kept *r, const node *n, const node *gate, front *to, const span *s) {
    const uint32_t need = n->need - 1;
    uint32_t cursor[RVAFT_SIBLINGS] = {0}, chosen[RVAFT_NEED] = {0}, count = need, end = 0, i, at, number;
    for (i = 0; i < n->children; i++) {
        const front *f = sibling(r, n, i);
        at = f == NULL ? 0 : f->tail;
        while (at != 0 && is_longer(s->least, span_at(m, at)->most, gate->limit)) {
            at = span_at(m, at)->before;
        }
        ROW(cursor, i) = at;
    }
    while (end < n->children && m->error == 0) {
        span whole = *s;
        count = 0;
        end = n->children; /* the sibling whose match ends last, after this one */
        for (i = 0; i < n->children; i++) {
            const uint32_t own = ROW(cursor, i);
            if (own == 0) {
                continue;
            }
            if (span_at(m, own)->most > (end < n->children ? span_at(m, ROW(cursor, end))->most : s->most)) {
                end = i;
            }
            if (count < need || span_at(m, own)->least > span_at(m, ROW(chosen, count - 1))->least) {
                at = count < need && count < RVAFT_NEED ? count++ : count - 1;
                for (; at > 0 && span_at(m, ROW(chosen, at - 1))->least < span_at(m, own)->least; at--) {
                    ROW(chosen, at) = ROW(chosen, at - 1);
                }
                ROW(chosen, at) = own;
            }
        }
        if (count < need || is_longer(span_at(m, ROW(chosen, count - 1))->least, s->most, gate->limit)) {
            return; /* those that end earlier start earlier, too */
        }
        for (i = 0; i < count; i++) {
            extend(&whole, span_at(m, ROW(chosen, i)));
        }
        number = is_longer(whole.least, whole.most, gate->limit) ? 0 : add_span(m, to, &whole, 0, 0);
        for (i = 0; number != 0 && i < count; i++) {
#if RVAFT_PLACES
            add_places(m, number, span_at(m, ROW(chosen, i))->events);
#endif
        }
        if (end < n->children) {
            ROW(cursor, end) = span_at(m, ROW(cursor, end))->before;
        }
    }
}

/* Join matches with matches of as many siblings as the gate needs besides. */
static void join_others(rvaft_monitor *m, const kept *r, const node *n, const node *gate, front *made) {
    const uint32_t need = n->need - 1;
    front chosen[RVAFT_NEED + 1] = {{0, 0}}; /* with matches of so many siblings */
    uint32_t full = 0, i, k, at;
    for (i = 0; i < n->children; i++) {
        full += sibling(r, n, i) != NULL;
    }
    if (full < need) {
        drop_front(m, made);
    } else if (need > 0 && (full == need || gate->limit == UINT64_MAX)) {
        for (i = 0, k = 0; i < n->children && k < need && m->error == 0; i++) {
            const front *f = sibling(r, n, i);
            if (f != NULL) {
                join_each(m, made, f, gate, 0);
                k++;
            }
        }
    } else if (need > 0 && !gate->inside) {
        for (at = made->head; at != 0 && m->error == 0; at = span_at(m, at)->next) {
            join_best(m, r, n, gate, &chosen[0], span_at(m, at));
        }
        drop_front(m, made);
        *made = chosen[0];
    } else if (need > 0) {
        chosen[0] = *made;
        for (i = 0; i < n->children; i++) {
            const front *f = sibling(r, n, i);
            for (k = need; f != NULL && k > 0; k--) {
                for (at = ROW(chosen, k - 1).head; at != 0 && m->error == 0; at = span_at(m, at)->next) {
                    join_front(m, &ROW(chosen, k), f, span_at(m, at), gate, 0);
                }
            }
        }
        *made = ROW(chosen, need);
        for (k = 0; k < need; k++) {
            drop_front(m, &ROW(chosen, k));
        }
    }
}

/* Complete a node by matches that end now, and what it completes above; returns 1 if one is left that detects. */
static int complete_node(rvaft_monitor *m, kept *r, uint32_t number, front *made) {
    uint32_t depth, at;
    for (depth = 0; depth < RVAFT_NODES && m->error == 0; depth++) {
        const node *n = &ROW(nodes, number), *gate = &ROW(nodes, n->gate);
        for (at = n->within == UINT64_MAX ? 0 : made->head; at != 0;) {
            const span *s = span_at(m, at);
            at = is_longer(s->least, s->most, n->within) ? drop_span(m, made, at) : s->next;
        }
        if (n->how == ROOT || made->head == 0) {
            return made->head != 0;
        }
        if (n->how == AFTER) {
            join_each(m, made, &ROW(r->fronts, n->elder), gate, n->apart);
        }
        for (at = n->place == NONE ? 0 : made->head; at != 0;) {
            at = keep_span(m, r, n, span_at(m, at)) || n->again ? span_at(m, at)->next : drop_span(m, made, at);
        }
        if (n->place != NONE && n->how != BESIDE) {
            return 0;
        }
        if (n->how == BESIDE && made->head != 0) {
            join_others(m, r, n, gate, made);
        }
        number = n->gate;
    }
    return 0;
}

#if RVAFT_RINGED

#if RVAFT_PLACES
/* Chain the events of a leaf from one of them on, to those before. Where most links are not needed any more,
   all are chained anew. */
static void chain_events(rvaft_monitor *m, ring *q, uint32_t at) {
    uint32_t link;
    if (q->links > 2 * q->size + 8) {
        q->links = 0;
        at = q->events.head;
    }
    link = at == 0 || span_at(m, at)->before == 0 || at == q->events.head ? 0 : span_at(m, span_at(m, at)->before)->events;
    for (; at != 0 && m->error == 0; at = span_at(m, at)->next) {
        span *s = span_at(m, at);
        uint32_t made = new_events(m, link, 0);
        if (made != 0) {
            const place at_event = events_at(m, s->events)->at;
            events_at(m, made)->at = at_event;
            release_events(m, s->events);
            s->events = made;
            q->links++;
        }
        link = made;
    }
}
#endif

/* Add an event to those of a leaf, in the order of time; returns it, or 0 if there is no room. */
static uint32_t insert_event(rvaft_monitor *m, ring *q, const span *event, const leaf *l) {
    uint32_t before = q->events.tail, later = 0, number;
    while (limit_of(l) != UINT64_MAX && before != 0 && span_at(m, before)->least > event->least) {
        before = span_at(m, before)->before;
        later++;
    }
    number = copy_span(m, &q->events, before, event);
    if (number == 0) {
        return 0;
    }
    q->size++;
    if (q->size <= l->count) {
        q->start = q->size == l->count ? q->events.head : 0;
    } else if (later < l->count) {
        q->start = span_at(m, q->start)->next;
    }
    q->in_turn = later != 0 ? 0 : q->in_turn < l->count ? q->in_turn + 1 : q->in_turn;
#if RVAFT_PLACES
    chain_events(m, q, number);
#endif
    return number;
}

/* Add the match of the events between two of them to a front. */
static void add_counted(rvaft_monitor *m, front *made, const leaf *l, uint32_t start, uint32_t end, uint64_t first) {
    const uint64_t limit = limit_of(l);
    span s = *span_at(m, start);
    s.most = span_at(m, end)->most;
    s.first = first;
    s.last = m->number;
    if (limit != UINT64_MAX && is_longer(s.least, s.most, limit)) {
        return;
    }
#if RVAFT_PLACES
    s.events = new_events(m, span_at(m, end)->events, 0);
    if (s.events == 0) {
        return;
    }
    events_at(m, s.events)->count = l->count;
#endif
    (void)add_span(m, made, &s, ROW(nodes, l->node).inside, 0);
#if RVAFT_PLACES
    release_events(m, s.events);
#endif
}

/* Add the matches of events that follow each other in time and have one of them; returns the lowest number of
   an event of a match, or UINT64_MAX. */
static uint64_t add_windows(rvaft_monitor *m, front *made, const leaf *l, uint32_t one) {
    uint32_t start = one, end = one, left = l->count - 1, at;
    uint64_t lowest = UINT64_MAX;
    for (; left > 0 && span_at(m, start)->before != 0; left--) {
        start = span_at(m, start)->before;
    }
    for (; left > 0 && end != 0; left--) {
        end = span_at(m, end)->next;
    }
    for (; end != 0 && m->error == 0; end = span_at(m, end)->next) {
        if (!is_longer(span_at(m, start)->least, span_at(m, end)->most, limit_of(l))) {
            uint64_t first = span_at(m, start)->first;
            for (at = start; ROW(nodes, l->node).inside && at != end && at != 0; at = span_at(m, at)->next) {
                first = span_at(m, at)->first < first ? span_at(m, at)->first : first;
            }
            first = span_at(m, end)->first < first && ROW(nodes, l->node).inside ? span_at(m, end)->first : first;
            lowest = first < lowest ? first : lowest;
            add_counted(m, made, l, start, end, first);
        }
        if (start == one) {
            break;
        }
        start = span_at(m, start)->next;
    }
    return lowest;
}

/* Add the matches with an event of which none begins later at no longer time: the later the first event has
   to be, the fewer events are left. */
static void add_all_windows(rvaft_monitor *m, front *made, const leaf *l, const ring *q, uint32_t one) {
    ring left = {0};
    const span event = *span_at(m, one);
    uint32_t at, own = 0;
    uint64_t lowest;
    for (at = q->events.head; at != 0 && m->error == 0; at = span_at(m, at)->next) {
        const span *s = span_at(m, at);
        if (!is_longer(s->least, event.least, limit_of(l)) && !is_longer(event.least, s->least, limit_of(l))) {
            uint32_t copy = copy_span(m, &left.events, left.events.tail, s);
            own = at == one ? copy : own;
            left.size++;
        }
    }
    while (own != 0 && left.size >= l->count && m->error == 0) {
#if RVAFT_PLACES
        left.links = 0;
        chain_events(m, &left, left.events.head);
#endif
        lowest = add_windows(m, made, l, own);
        if (lowest == UINT64_MAX) {
            break;
        }
        for (at = left.events.head; at != 0;) {
            if (span_at(m, at)->first <= lowest) {
                at = drop_span(m, &left.events, at);
                left.size--;
            } else {
                at = span_at(m, at)->next;
            }
        }
    }
    drop_front(m, &left.events);
}

/* Add an event to those of a leaf with `times`, and the matches with it to a front. */
static void count_event_of(rvaft_monitor *m, kept *r, const leaf *l, const span *event, front *made) {
    ring *q = &ROW(r->rings, l->ring);
    const int inside = ROW(nodes, l->node).inside, is_timed = limit_of(l) != UINT64_MAX;
    uint32_t one;
    if (is_timed && RVAFT_LATE >= 0 && m->has_latest) {
        trim_ring(m, q, m->latest, limit_of(l));
    }
    if (!is_timed && q->size >= l->count) {
        drop_event(m, q);
    }
    one = insert_event(m, q, event, l);
    if (one == 0) {
        return;
    }
    if (one == q->events.tail && (q->in_turn == l->count || !inside || !is_timed)) {
        if (q->start != 0) {
            add_counted(m, made, l, q->start, one, span_at(m, q->start)->first);
        }
    } else if (!inside) {
        (void)add_windows(m, made, l, one);
    } else {
        add_all_windows(m, made, l, q, one);
    }
}
#endif

/* Take an event at a leaf; returns 1 if it detects. */
static int take(rvaft_monitor *m, const rvaft_event *e, kept *r, const leaf *l) {
    front made = {0, 0};
    span s = {0};
    int detected;
    s.least = s.most = e->has_time ? e->time : 0;
    s.first = s.last = m->number;
#if RVAFT_PLACES
    s.events = new_events(m, 0, 0);
    if (s.events == 0) {
        return 0;
    }
    events_at(m, s.events)->at = e->at;
#endif
    if (l->count == 1) {
        (void)copy_span(m, &made, 0, &s);
    }
#if RVAFT_RINGED
    else {
        kept *own = counting(m, e, r, l);
        if (own != NULL) {
            count_event_of(m, own, l, &s, &made);
        }
    }
#endif
#if RVAFT_PLACES
    release_events(m, s.events);
#endif
    detected = m->error == 0 && complete_node(m, r, l->node, &made) && m->error == 0;
#if RVAFT_PLACES
    if (detected) {
        note_match(m, span_at(m, made.head)->events);
    }
#endif
    drop_front(m, &made);
    return detected;
}

/* @state */
static const span *shown(const rvaft_monitor *m, uint32_t number) { return &ROW(m->spans.item, number - 1U); }

/* How many numbers of events, of those that matter to an instance of a kind, are lower. */
static uint64_t rank_of(const rvaft_monitor *m, const kept *r, uint32_t number, uint64_t event) {
    uint64_t rank = 0;
    uint32_t i, at;
    for (i = 0; i < RVAFT_NODES; i++) {
        const node *n = &ROW(nodes, i);
        const int first = ROW(nodes, n->gate).inside, last = n->before;
        at = n->place != NONE && n->unit == number && (first || last) ? ROW(r->fronts, n->place).head : 0;
        for (; at != 0; at = shown(m, at)->next) {
            rank += (first && shown(m, at)->first < event) + (uint64_t)(last && shown(m, at)->last < event);
        }
    }
    for (i = 0; i < RVAFT_LEAVES; i++) {
        const leaf *l = &leaves[i];
        at = l->count > 1 && l->kind == number && ROW(nodes, l->node).inside ? ROW(r->rings, l->ring).events.head : 0;
        for (; at != 0; at = shown(m, at)->next) {
            rank += shown(m, at)->first < event;
        }
    }
    return rank;
}

/* Append what an instance of a kind keeps; returns whether that is anything. */
static int put_kept(const rvaft_monitor *m, const kept *r, uint32_t number, char *to, size_t size, size_t *used) {
    uint32_t i, at, left;
    int some = 0;
    for (i = 0; i < RVAFT_NODES; i++) {
        const node *n = &ROW(nodes, i), *gate = &ROW(nodes, n->gate);
        if (n->place == NONE || n->unit != number) {
            continue;
        }
        left = 0;
        for (at = ROW(r->fronts, n->place).head; at != 0; at = shown(m, at)->next) {
            const span *s = shown(m, at);
            const uint64_t first = gate->inside ? rank_of(m, r, number, s->first) : 0;
            const uint64_t last = n->before ? rank_of(m, r, number, s->last) : 0;
            const int64_t times[2] = {gate->limit == UINT64_MAX ? 0 : s->least, gate->limit == UINT64_MAX ? 0 : s->most};
            put_state(to, size, used, times, sizeof times);
            put_state(to, size, used, &first, sizeof first);
            put_state(to, size, used, &last, sizeof last);
            left++;
            some = 1;
        }
        put_state(to, size, used, &left, sizeof left);
    }
    for (i = 0; i < RVAFT_LEAVES; i++) {
        const leaf *l = &leaves[i];
        const int is_timed = limit_of(l) != UINT64_MAX;
        if (l->count == 1 || l->kind != number) {
            continue;
        }
        left = ROW(r->rings, l->ring).size;
        for (at = ROW(r->rings, l->ring).events.head; at != 0; at = shown(m, at)->next) {
            const span *s = shown(m, at);
            const uint64_t first = ROW(nodes, l->node).inside ? rank_of(m, r, number, s->first) : 0;
            if (is_timed) {
                put_state(to, size, used, &s->least, sizeof s->least);
            }
            put_state(to, size, used, &first, sizeof first);
            some = 1;
        }
        left = !is_timed && left >= l->count ? l->count - 1 : left; /* the oldest one leaves */
        put_state(to, size, used, &left, sizeof left);
    }
    return some;
}

