/* @types */
/* The first event of a match, and where places are kept, all its events. */
typedef struct match_start {
    uint64_t first; /* its number, or 0 for no match */
#if RVAFT_WINDOWS
    int64_t time;
#endif
#if RVAFT_PLACES
    uint32_t events;
#endif
} match_start;

/* The last events of a leaf with `times`. */
typedef struct ring {
    uint32_t next; /* the place of the next event, and of the oldest one if the ring is full */
    uint32_t full;
#if RVAFT_PLACES
    uint32_t recent; /* the events since the place was 0 */
#endif
} ring;

/* What an instance keeps: for each node the match that starts last, with the matches that had to be complete
   before its first event, innermost first; and the last events of leaves with `times`. */
typedef struct kept {
    uint32_t order[RVAFT_ORDER]; /* the nodes below each gate without order, the last start first */
    ring rings[RVAFT_RINGS];
    match_start starts[RVAFT_STARTS];
} kept;

/* @rows */
enum { ROOT, ONLY, BESIDE, FIRST, AFTER, ENDING };

/* How a match of a node completes the gate above: as its root, as ONLY one, with others BESIDE it, as the
   FIRST of a sequence, or the one AFTER those that were complete at its first event, or ENDING after them. */
typedef struct node {
    uint64_t within; /* the longest duration of a match in nanoseconds */
    uint32_t gate;
    uint32_t place; /* of its latest start in an instance; NONE if a match is not kept */
    uint32_t elder; /* ENDING: the place of the latest start of the children before */
    uint32_t order; /* BESIDE: the place in `order` of the children of the gate */
    uint32_t children;
    uint32_t need; /* the number of children that complete the gate */
    uint16_t levels;
    uint8_t how;
    uint8_t again; /* whether a match with the same start may complete the gate again */
} node;

/* @kept */
#if RVAFT_PLACES
/* Replace the events of a start by others, whose reference it takes. */
static void set_events(rvaft_monitor *m, match_start *to, uint32_t number) {
    release_events(m, to->events);
    to->events = number;
}

#endif

/* Replace a start. */
static void set_start(rvaft_monitor *m, match_start *to, const match_start *from) {
    match_start moved = *from;
    (void)m;
#if RVAFT_PLACES
    retain_events(m, moved.events);
    release_events(m, to->events);
#endif
    *to = moved;
}

/* Copy the starts of some levels into an instance, or from it. */
static void keep_starts(rvaft_monitor *m, kept *r, uint32_t at, const match_start *made, uint32_t levels) {
    uint32_t i;
    for (i = 0; i < levels && i < RVAFT_LEVELS; i++) {
        set_start(m, &ROW(r->starts, at + i), &made[i]);
    }
}

static void recall_starts(rvaft_monitor *m, match_start *made, const kept *r, uint32_t at, uint32_t levels) {
    uint32_t i;
    for (i = 0; i < levels && i < RVAFT_LEVELS; i++) {
        set_start(m, &made[i], &ROW(r->starts, at + i));
    }
}

/* Whether a match is kept at a place. */
static int is_kept(const kept *r, uint32_t at) { return ROW(r->starts, at).first != 0; }

/* Make empty what an instance keeps, whatever its memory has. */
static void forget_kept(kept *r) {
    uint32_t i;
    for (i = 0; i < RVAFT_STARTS; i++) {
        r->starts[i].first = 0;
#if RVAFT_PLACES
        r->starts[i].events = 0;
#endif
    }
    for (i = 0; i < RVAFT_RINGS; i++) {
        r->rings[i].next = 0;
        r->rings[i].full = 0;
#if RVAFT_PLACES
        r->rings[i].recent = 0;
#endif
    }
    for (i = 0; i < RVAFT_ORDER; i++) {
        r->order[i] = 0;
    }
}

/* Release what an instance keeps. */
RVAFT_UNUSED static void drop_kept(rvaft_monitor *m, kept *r) {
#if RVAFT_PLACES
    uint32_t i;
    for (i = 0; i < RVAFT_STARTS; i++) {
        release_events(m, r->starts[i].events);
    }
    for (i = 0; i < RVAFT_RINGS; i++) {
        release_events(m, r->rings[i].recent);
    }
#endif
    (void)m;
    forget_kept(r);
}

#define begin_kept(m) (void)(m)
#define is_crowded(m) 0
#define has_little_room(m) 0
#define set_crowded(m) (void)(m)
#define trim_kept(m, r, number, latest) (void)(r)

/* @steps */
/* Put a node before those that start earlier. */
static void set_in_order(kept *r, const node *n, uint32_t number) {
    uint32_t first = n->order, at = first, stop = first + n->children - 1;
    while (at < stop && ROW(r->order, at) != 0 && ROW(r->order, at) != number) {
        at++;
    }
    for (; at > first; at--) {
        uint32_t other = ROW(r->order, at - 1);
        if (ROW(r->starts, ROW(nodes, other).place).first > ROW(r->starts, n->place).first) {
            break;
        }
        ROW(r->order, at) = other;
    }
    ROW(r->order, at) = number;
}

/* Join a match with another one, which is kept at a place. */
static void join_with(rvaft_monitor *m, match_start *made, const kept *r, uint32_t at, uint32_t levels) {
    const match_start *other = &ROW(r->starts, at);
#if RVAFT_PLACES
    uint32_t all = joined_events(m, other->events, made->events);
#endif
    if (other->first < made->first) {
        recall_starts(m, made, r, at, levels);
    }
#if RVAFT_PLACES
    set_events(m, made, all);
#endif
}

/* Join a match with those of siblings that start last; returns 0 if there are too few. */
static int join_others(rvaft_monitor *m, const kept *r, const node *n, uint32_t number, match_start *made) {
    uint32_t at = n->order, left = n->need - 1;
    if (ROW(r->order, at + left) == 0) {
        return 0;
    }
    for (; left > 0 && at < RVAFT_ORDER; at++) {
        uint32_t other = r->order[at];
        if (other != number) {
            join_with(m, made, r, ROW(nodes, other).place, n->levels);
            left--;
        }
    }
    return 1;
}

/* Join a match with the one before, as it was at the first event: the whole starts where that does. */
static void join_before(rvaft_monitor *m, match_start *made, uint32_t levels) {
    uint32_t i;
#if RVAFT_PLACES
    uint32_t all = joined_events(m, made[RVAFT_LEVELS > 1].events, made->events);
#endif
    for (i = 0; i < levels && i + 1 < RVAFT_LEVELS; i++) {
        set_start(m, &made[i], &made[i + 1]);
    }
#if RVAFT_PLACES
    set_events(m, made, all);
#endif
}

/* Complete a node by a match that ends now, and what it completes above; returns 1 if it detects. */
static int complete_node(rvaft_monitor *m, const rvaft_event *e, kept *r, uint32_t number, match_start *made) {
    uint32_t depth;
    (void)e;
    for (depth = 0; depth < RVAFT_NODES && m->error == 0; depth++) {
        const node *n = &ROW(nodes, number);
#if RVAFT_WINDOWS
        if (n->within != UINT64_MAX && (uint64_t)e->time - (uint64_t)made->time > n->within) {
            return 0;
        }
#endif
        if (n->how == ROOT) {
            return 1;
        }
        if (n->how == AFTER) {
            join_before(m, made, n->levels);
        } else if (n->how == ENDING) {
            if (!is_kept(r, n->elder)) {
                return 0;
            }
            join_with(m, made, r, n->elder, n->levels);
        }
        if (n->place != NONE) {
            int later = made->first > ROW(r->starts, n->place).first;
            if (later) {
                keep_starts(m, r, n->place, made, n->levels);
            }
            if (n->how != BESIDE || !(later || n->again)) {
                return 0;
            }
            if (later) {
                set_in_order(r, n, number);
            }
            if (!join_others(m, r, n, number, made)) {
                return 0;
            }
        }
        number = n->gate;
    }
    return 0;
}

#if RVAFT_RINGED

#if RVAFT_PLACES
/* The events of a match at a place of a ring. */
static match_start *ring_start(kept *r, const leaf *l, uint32_t number) {
    return &ROW(r->starts, l->room + number * l->levels);
}

/* Add an event to the last ones; returns all of them. The events up to the last place are joined
   backwards, those from the first place forwards, so that all of them take two steps for each event. */
static uint32_t last_events(rvaft_monitor *m, kept *r, const leaf *l, ring *q, uint32_t number) {
    uint32_t all = joined_events(m, q->recent, number), i;
    release_events(m, q->recent);
    q->recent = all;
    if (q->next != 0) {
        return joined_events(m, ring_start(r, l, q->next)->events, all);
    }
    for (i = l->count - 1; i > 0; i--) {
        match_start *s = ring_start(r, l, i - 1);
        set_events(m, s, joined_events(m, s->events, ring_start(r, l, i)->events));
    }
    q->recent = 0;
    return all;
}
#endif

/* Add an event to the last ones of its leaf; returns 0 while they are too few, or else their match. */
static int count_last(rvaft_monitor *m, kept *r, const leaf *l, match_start *made) {
    ring *q = &ROW(r->rings, l->ring);
#if RVAFT_PLACES
    uint32_t all;
#endif
    keep_starts(m, r, l->room + q->next * l->levels, made, l->levels);
    q->next++;
    if (q->next >= l->count) {
        q->next = 0;
        q->full = 1;
    }
#if RVAFT_PLACES
    all = last_events(m, r, l, q, made->events);
#endif
    if (q->full) {
        recall_starts(m, made, r, l->room + q->next * l->levels, l->levels);
    }
#if RVAFT_PLACES
    set_events(m, made, all);
#endif
    return q->full != 0;
}

#endif

#if RVAFT_RINGED
/* Add an event to the last ones of a leaf with `times`; returns 0 while they are too few. */
static int take_last(rvaft_monitor *m, const rvaft_event *e, kept *r, const leaf *l, match_start *made) {
    kept *own = counting(m, e, r, l);
    return own != NULL && count_last(m, own, l, made);
}
#else
#define take_last(m, e, r, l, made) 1
#endif

/* Take an event at a leaf; returns 1 if it detects. */
static int take(rvaft_monitor *m, const rvaft_event *e, kept *r, const leaf *l) {
    match_start made[RVAFT_LEVELS];
    int detected;
#if RVAFT_PLACES
    uint32_t i;
#endif
    memset(made, 0, sizeof made);
    made->first = m->number;
#if RVAFT_WINDOWS
    made->time = e->has_time ? e->time : 0;
#endif
#if RVAFT_PLACES
    made->events = new_events(m, 0, 0);
    if (made->events == 0) {
        return 0;
    }
    events_at(m, made->events)->at = e->at;
#endif
#if RVAFT_LEVELS > 1
    if (l->after != NONE) {
        recall_starts(m, made + 1, r, l->after, l->levels - 1);
    }
#endif
    detected = (l->count == 1 || take_last(m, e, r, l, made)) && complete_node(m, e, r, l->node, made) && m->error == 0;
#if RVAFT_PLACES
    if (detected) {
        note_match(m, made->events);
    }
    for (i = 0; i < RVAFT_LEVELS; i++) {
        release_events(m, made[i].events);
    }
#endif
    return detected;
}


/* @state */
/* Append matches of an instance: whether they are kept, and when they start. Returns whether one is. */
static int put_starts(const kept *r, uint32_t at, uint32_t count, char *to, size_t size, size_t *used) {
    uint32_t i;
    int some = 0;
    for (i = 0; i < count; i++) {
        const match_start *s = &ROW(r->starts, at + i);
        uint8_t kept = s->first != 0;
        put_state(to, size, used, &kept, 1);
#if RVAFT_WINDOWS
        if (kept) {
            put_state(to, size, used, &s->time, sizeof s->time);
        }
#endif
        some |= kept;
    }
    return some;
}

/* Append what an instance keeps; returns whether that is anything. */
static int put_kept(const rvaft_monitor *m, const kept *r, uint32_t number, char *to, size_t size, size_t *used) {
    uint32_t i, k;
    int some = put_starts(r, 0, ROW(kinds, number).slots, to, size, used);
    (void)m;
    for (i = 0; i < RVAFT_LEAVES; i++) {
        const leaf *l = &leaves[i];
        if (l->count > 1 && l->kind == number) {
            const ring *q = &ROW(r->rings, l->ring);
            uint32_t at = q->full ? (q->next + 1) % l->count : 0, stop = q->next; /* the oldest one leaves */
            for (k = at; k != stop; k = (k + 1) % l->count) {
                some |= put_starts(r, l->room + k * l->levels, l->levels, to, size, used);
            }
            stop = NONE;
            put_state(to, size, used, &stop, sizeof stop);
        }
    }
    return some;
}


