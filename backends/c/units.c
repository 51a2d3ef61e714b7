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

/* What is known of the events with one value of the key of a unit: for each node the match that starts
   last, with the matches that had to be complete before its first event, innermost first. The events
   of a leaf with `times` and variables of its own are an instance, too. */
typedef struct instance {
#if RVAFT_NAMED
    uint32_t next;
    uint32_t kind; /* NONE if free */
#if RVAFT_KEYED
    uint32_t key;
    uint32_t era; /* of the key */
#endif
#if RVAFT_EXPIRIES
    int64_t latest; /* the time of the last event */
#endif
    cell name[RVAFT_NAMES];
#endif
    uint32_t order[RVAFT_ORDER]; /* the nodes below each gate without order, the last start first */
    ring rings[RVAFT_RINGS];
    match_start starts[RVAFT_STARTS];
} instance;

typedef struct instance_table {
#if RVAFT_NAMED
    uint32_t count; /* instances, with those that are free */
    uint32_t used;
    uint32_t spare; /* the first free instance, plus 1 */
    uint32_t sweep_at;
    uint32_t mask; /* of the buckets in use: fewer stay in the cache */
    uint32_t touched; /* instances that ever were in use: the memory of others is zero */
    uint32_t head[RVAFT_BUCKETS]; /* an instance, plus 1 */
#endif
    instance item[RVAFT_INSTANCES + 1]; /* the one after the last is not kept */
} instance_table;

#if RVAFT_PLACES
/* Events of matches: one, or those of two others. Numbers are places in the table, plus 1. */
typedef struct some_events {
    place at;
    uint32_t left;
    uint32_t right;
    uint32_t used; /* the number of references, or the next free one */
} some_events;

typedef struct event_table {
    uint32_t count;
    uint32_t spare;
    some_events item[RVAFT_EVENTS];
} event_table;

typedef struct found_match {
    uint32_t taken;
    place events[RVAFT_DEPTH];
    uint32_t agenda[RVAFT_DEPTH + 1];
} found_match;
#endif

/* @members */
    uint64_t number; /* of the last event */
    instance_table instances;
#if RVAFT_PLACES
    event_table events;
    found_match match; /* after a detection */
#endif

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

typedef struct leaf {
    uint32_t node;
    uint32_t unit;
    uint32_t pattern;
    uint32_t guard;  /* 0: none */
    uint32_t after;  /* the place of the match that must be complete before; NONE for none */
    uint32_t levels; /* 1, and the levels of that match */
    uint32_t names;  /* the first field in `names` that names its instance */
    uint32_t kind;   /* of the instance with its last events */
    uint32_t count;
    uint32_t ring;
    uint32_t room;  /* the place of the last events in `starts` */
    uint16_t timed; /* whether a window needs the time of the event */
    uint16_t settled; /* whether no event is of use once the leaf, or a node above, is complete */
} leaf;

typedef struct kind {
    uint32_t names;
    uint32_t slots; /* the number of starts of matches */
    uint64_t within; /* without an event for longer, an instance is over */
} kind;

/* @marks */
static const kind *kind_of(const instance *r) { return &ROW(kinds, r->kind); }

static void sweep(rvaft_monitor *m);

static void mark_texts(rvaft_monitor *m) {
    uint32_t i, k;
    sweep(m);
    memset(m->texts.live, 0, sizeof m->texts.live);
    for (i = 0; i < m->instances.count && i < RVAFT_INSTANCES; i++) {
        const instance *r = &m->instances.item[i];
        for (k = 0; r->kind != NONE && k < kind_of(r)->names; k++) {
            mark_text(&m->texts, &ROW(r->name, k));
        }
    }
    for (i = 0; i < RVAFT_FIELDS; i++) {
        if (m->known[i] == 2) {
            mark_text(&m->texts, &m->cells[i]);
        }
    }
}

/* @matches */
/* Events of matches. What is not used any more is released when its place is used again, so that each
   step is short. */

#if RVAFT_PLACES

static some_events *events_at(rvaft_monitor *m, uint32_t number) { return &ROW(m->events.item, number - 1U); }

static void retain_events(rvaft_monitor *m, uint32_t number) {
    if (number != 0) {
        events_at(m, number)->used++;
    }
}

static void release_events(rvaft_monitor *m, uint32_t number) {
    if (number != 0) {
        some_events *s = events_at(m, number);
        if (s->used > 1) {
            s->used--;
        } else {
            s->used = m->events.spare;
            m->events.spare = number;
        }
    }
}

/* Other events, with a reference, or 0 if there is no room. */
static uint32_t new_events(rvaft_monitor *m, uint32_t left, uint32_t right) {
    event_table *t = &m->events;
    uint32_t number = t->spare;
    some_events *s;
    if (number != 0) {
        s = events_at(m, number);
        t->spare = s->used;
        release_events(m, s->left);
        release_events(m, s->right);
    } else if (t->count < RVAFT_EVENTS) {
        number = ++t->count;
        s = events_at(m, number);
    } else {
        m->error = RVAFT_FULL;
        return 0;
    }
    s->left = left;
    s->right = right;
    s->used = 1;
    retain_events(m, left);
    retain_events(m, right);
    return number;
}

static uint32_t joined_events(rvaft_monitor *m, uint32_t left, uint32_t right) {
    if (left != 0 && right != 0) {
        return new_events(m, left, right);
    }
    left = left != 0 ? left : right;
    retain_events(m, left);
    return left;
}

/* Note the places of some events in the order of the log. */
static void note_match(rvaft_monitor *m, uint32_t number) {
    found_match *f = &m->match;
    uint32_t left = 1;
    f->taken = 0;
    f->agenda[0] = number;
    while (left > 0 && left <= RVAFT_DEPTH) {
        const some_events *s = events_at(m, f->agenda[--left]);
        if (s->left == 0) {
            uint32_t to = f->taken < RVAFT_DEPTH ? f->taken++ : 0;
            for (; to > 0 && f->events[to - 1].number > s->at.number; to--) {
                place moved = f->events[to - 1];
                f->events[to] = moved;
            }
            f->events[to] = s->at;
        } else if (left < RVAFT_DEPTH) {
            f->agenda[left++] = s->right;
            f->agenda[left++] = s->left;
        }
    }
}

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
static void keep_starts(rvaft_monitor *m, instance *r, uint32_t at, const match_start *made, uint32_t levels) {
    uint32_t i;
    for (i = 0; i < levels && i < RVAFT_LEVELS; i++) {
        set_start(m, &ROW(r->starts, at + i), &made[i]);
    }
}

static void recall_starts(rvaft_monitor *m, match_start *made, const instance *r, uint32_t at, uint32_t levels) {
    uint32_t i;
    for (i = 0; i < levels && i < RVAFT_LEVELS; i++) {
        set_start(m, &made[i], &ROW(r->starts, at + i));
    }
}

/* Whether a match is kept at a place. */
static int is_kept(const instance *r, uint32_t at) { return ROW(r->starts, at).first != 0; }

/* Instances. */

/* Make an instance empty. */
static void clear_instance(instance *r) {
    uint32_t i;
#if RVAFT_SLOTS > 0
    for (i = 0; i < RVAFT_SLOTS; i++) {
        r->starts[i].first = 0;
    }
#endif
    for (i = 0; i < RVAFT_RINGS; i++) {
        r->rings[i].next = 0;
        r->rings[i].full = 0;
    }
    for (i = 0; i < RVAFT_ORDER; i++) {
        r->order[i] = 0;
    }
}

#if RVAFT_PLACES
/* Drop the events of an instance, and release them. */
static void drop_events(rvaft_monitor *m, instance *r, int released) {
    uint32_t i;
    for (i = 0; i < RVAFT_STARTS; i++) {
        release_events(m, released ? r->starts[i].events : 0);
        r->starts[i].events = 0;
    }
    for (i = 0; i < RVAFT_RINGS; i++) {
        release_events(m, released ? r->rings[i].recent : 0);
        r->rings[i].recent = 0;
    }
}

/* Release the events of a match, and those of an instance that is not kept. */
static void drop_match(rvaft_monitor *m, instance *r, match_start *made) {
    uint32_t i;
    for (i = 0; i < RVAFT_LEVELS; i++) {
        release_events(m, made[i].events);
    }
#if RVAFT_NAMED
    if (r == &m->instances.item[RVAFT_INSTANCES]) {
        drop_events(m, r, 1);
    }
#endif
    (void)r;
}
#endif

#if RVAFT_NAMED

#if RVAFT_KEYED
#define CURRENT_KEY(m) ((m)->key)
static int is_void(const rvaft_monitor *m, const instance *r) {
    return m->keys.item[r->key < RVAFT_KEYS ? r->key : 0].era != r->era;
}
static int has_key(const rvaft_monitor *m, const instance *r) { return r->key == m->key && !is_void(m, r); }
#else
#define CURRENT_KEY(m) 0U
#define is_void(m, r) 0
#define has_key(m, r) 1
#endif

/* Whether no later event can be in a match with those of an instance. */
static int is_over(const rvaft_monitor *m, const instance *r) {
#if RVAFT_EXPIRIES
#if RVAFT_KEYED
    const key_state *seen = &m->keys.item[r->key < RVAFT_KEYS ? r->key : 0];
#else
    const rvaft_monitor *seen = m;
#endif
    if (seen->has_latest && seen->latest > r->latest &&
        (uint64_t)seen->latest - (uint64_t)r->latest > kind_of(r)->within) {
        return 1;
    }
#endif
    (void)m;
    (void)r;
    return is_void(m, r);
}

static uint64_t hash_with(uint64_t h, const cell *c) {
    h = (h ^ c->hash) * UINT64_C(0xD6E8FEB86659FD93);
    return h ^ h >> 32;
}

static uint64_t hash_of(uint32_t number, uint32_t key) {
    return ((uint64_t)number << 32 ^ key) * UINT64_C(0x9E3779B97F4A7C15);
}

static uint32_t *bucket_of(instance_table *t, uint64_t h) {
    h *= UINT64_C(0x9E3779B97F4A7C15);
    return &t->head[(uint32_t)(h >> 32 ^ h >> 61) & t->mask & (RVAFT_BUCKETS - 1)];
}

static void link_instance(instance_table *t, uint32_t number) {
    instance *r = &t->item[number];
    uint32_t i, *home;
#if RVAFT_KEYED
    uint64_t h = hash_of(r->kind, r->key);
#else
    uint64_t h = hash_of(r->kind, 0);
#endif
    for (i = 0; i < kind_of(r)->names; i++) {
        h = hash_with(h, &ROW(r->name, i));
    }
    home = bucket_of(t, h);
    r->next = *home;
    *home = number + 1;
}

/* Remove the instances that are over, and adapt the number of buckets; again when there are twice as
   many, so that the work per event stays bounded. */
static void sweep(rvaft_monitor *m) {
    instance_table *t = &m->instances;
    uint32_t i;
    for (i = 0; i < t->count && i < RVAFT_INSTANCES; i++) {
        instance *r = &t->item[i];
        if (r->kind != NONE && is_over(m, r)) {
#if RVAFT_PLACES
            drop_events(m, r, 1);
#endif
            r->kind = NONE;
            r->next = t->spare;
            t->spare = i + 1;
            t->used--;
        }
    }
    while (t->mask < RVAFT_BUCKETS - 1 && t->mask < 4 * t->used) {
        t->mask = t->mask * 2 + 1;
    }
    for (i = 0; i <= t->mask && i < RVAFT_BUCKETS; i++) {
        t->head[i] = 0;
    }
    for (i = 0; i < t->count && i < RVAFT_INSTANCES; i++) {
        if (t->item[i].kind != NONE) {
            link_instance(t, i);
        }
    }
    t->sweep_at = t->used < FEW ? 2 * FEW : 2 * t->used;
    t->sweep_at = t->sweep_at < RVAFT_INSTANCES ? t->sweep_at : RVAFT_INSTANCES;
}

static int same_cell(const cell *a, const cell *b) { return a->tag == b->tag && a->bits == b->bits; }

/* A new instance with the values of an event, or NULL if there is no room. */
static instance *new_instance(rvaft_monitor *m, const rvaft_event *e, const leaf *l, uint32_t number) {
    instance_table *t = &m->instances;
    instance *r;
    uint32_t i, at;
    if (t->used >= t->sweep_at) {
        sweep(m);
    }
    at = t->spare;
    if (at != 0) {
        r = &ROW(t->item, at - 1);
        t->spare = r->next;
    } else if (t->count < RVAFT_INSTANCES) {
        at = ++t->count;
        r = &ROW(t->item, at - 1);
#if RVAFT_PLACES
        if (at <= t->touched) {
            drop_events(m, r, 0);
        }
        t->touched = at > t->touched ? at : t->touched;
#endif
    } else {
        m->error = RVAFT_FULL;
        return NULL;
    }
    r->kind = NONE; /* while texts are stored */
    for (i = 0; i < ROW(kinds, number).names && i < RVAFT_NAMES; i++) {
        r->name[i] = *cell_of(m, e, ROW(names, l->names + i), 1);
    }
    if (m->error != 0) {
        return NULL;
    }
    r->kind = number;
#if RVAFT_KEYED
    r->key = m->key;
    r->era = ROW(m->keys.item, m->key).era;
#endif
    t->used++;
    link_instance(t, at - 1);
    clear_instance(r);
    return r;
}

/* The instance of an event at a leaf, or NULL. With `make` it is made, and where a value is undefined, it
   is not kept. */
static instance *instance_of(rvaft_monitor *m, const rvaft_event *e, const leaf *l, uint32_t number, int make) {
    instance_table *t = &m->instances;
    uint64_t h = hash_of(number, CURRENT_KEY(m));
    uint32_t i, at, count = ROW(kinds, number).names;
    instance *r;
    for (i = 0; i < count; i++) {
        const cell *c = cell_of(m, e, ROW(names, l->names + i), 0);
        if (c->tag == RVAFT_UNDEFINED) {
            r = &t->item[RVAFT_INSTANCES];
            if (make) {
                clear_instance(r);
            }
            return make ? r : NULL;
        }
        h = hash_with(h, c);
    }
    for (at = *bucket_of(t, h); at != 0 && at <= RVAFT_INSTANCES; at = t->item[at - 1].next) {
        r = &t->item[at - 1];
        if (r->kind == number && has_key(m, r)) {
            int equal = 1;
            for (i = 0; equal && i < count; i++) {
                equal = same_cell(cell_of(m, e, ROW(names, l->names + i), 0), &ROW(r->name, i));
            }
            if (equal) {
                return r;
            }
        }
    }
    return make ? new_instance(m, e, l, number) : NULL;
}

#else

static instance *instance_of(rvaft_monitor *m, const rvaft_event *e, const leaf *l, uint32_t number, int make) {
    (void)e;
    (void)l;
    (void)make;
    return &ROW(m->instances.item, number);
}

#endif

/* Matches. */

/* Put a node before those that start earlier. */
static void set_in_order(instance *r, const node *n, uint32_t number) {
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
static void join_with(rvaft_monitor *m, match_start *made, const instance *r, uint32_t at, uint32_t levels) {
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
static int join_others(rvaft_monitor *m, const instance *r, const node *n, uint32_t number, match_start *made) {
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
static int complete_node(rvaft_monitor *m, const rvaft_event *e, instance *r, uint32_t number, match_start *made) {
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
static match_start *ring_start(instance *r, const leaf *l, uint32_t number) {
    return &ROW(r->starts, l->room + number * l->levels);
}

/* Add an event to the last ones; returns all of them. The events up to the last place are joined
   backwards, those from the first place forwards, so that all of them take two steps for each event. */
static uint32_t last_events(rvaft_monitor *m, instance *r, const leaf *l, ring *q, uint32_t number) {
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
static int count_last(rvaft_monitor *m, instance *r, const leaf *l, match_start *made) {
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

#if RVAFT_EXPIRIES
#define NOTE_TIME(r, e) (r)->latest = (e)->has_time ? (e)->time : (r)->latest
#else
#define NOTE_TIME(r, e) (void)(r)
#endif

/* Whether a node, or one above it, is complete. */
static int is_settled(const instance *r, uint32_t number) {
    uint32_t depth;
    for (depth = 0; depth < RVAFT_NODES; depth++) {
        const node *n = &ROW(nodes, number);
        if (n->how == ROOT) {
            return 0;
        }
        if (n->place != NONE && is_kept(r, n->place)) {
            return 1;
        }
        number = n->gate;
    }
    return 0;
}

/* The instance of an event that may serve a leaf, or NULL. */
static instance *serving(rvaft_monitor *m, const rvaft_event *e, const leaf *l) {
    instance *r = NULL;
    if (l->timed && !e->has_time) {
        return NULL;
    }
    if (l->after != NONE) {
        r = instance_of(m, e, l, l->unit, 0);
        if (r == NULL || !is_kept(r, l->after)) {
            return NULL;
        }
    }
    if ((l->guard != 0 && !guard(&m->error, l->guard, e)) || m->error != 0) {
        return NULL;
    }
    return r == NULL ? instance_of(m, e, l, l->unit, 1) : r;
}

#if RVAFT_RINGED
/* Add an event to the last ones of a leaf with `times`; returns 0 while they are too few. */
static int take_last(rvaft_monitor *m, const rvaft_event *e, instance *r, const leaf *l, match_start *made) {
    if (l->kind != l->unit) {
        r = instance_of(m, e, l, l->kind, 1);
        if (r == NULL) {
            return 0;
        }
        NOTE_TIME(r, e);
    }
    return count_last(m, r, l, made);
}
#else
#define take_last(m, e, r, l, made) 1
#endif

/* Take an event at a leaf; returns 1 if it detects. */
static int take_event(rvaft_monitor *m, const rvaft_event *e, const leaf *l) {
    match_start made[RVAFT_LEVELS];
    instance *r = serving(m, e, l);
    int detected;
    if (r == NULL) {
        return 0;
    }
    NOTE_TIME(r, e);
    if (l->settled && is_settled(r, l->node)) {
        return 0;
    }
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
    drop_match(m, r, made);
#endif
    return detected;
}

/* Take an event at all leaves, the last ones of sequences first, so that no event is used twice. */
/*@ assigns *m; */
static int scattered(rvaft_monitor *m, const rvaft_event *e, const uint8_t *matches) {
    uint32_t i;
    for (i = 0; i < RVAFT_LEAVES; i++) {
        const leaf *l = &leaves[i];
        if (matches[l->pattern] && take_event(m, e, l)) {
            return 1;
        }
        if (m->error != 0) {
            return 0;
        }
    }
    return 0;
}

/* @begin */
static void begin(rvaft_monitor *m) {
#if RVAFT_NAMED
    instance_table *t = &m->instances;
    uint32_t i;
    for (i = 0; i <= t->mask && i < RVAFT_BUCKETS && t->mask != 0; i++) {
        t->head[i] = 0;
    }
    t->mask = FEW;
    t->count = 0;
    t->used = 0;
    t->spare = 0;
    t->sweep_at = RVAFT_INSTANCES < 2 * FEW ? RVAFT_INSTANCES : 2 * FEW;
#else
    uint32_t i;
    for (i = 0; i < RVAFT_INSTANCES; i++) {
        clear_instance(&m->instances.item[i]);
#if RVAFT_PLACES
        drop_events(m, &m->instances.item[i], 0);
#endif
    }
#endif
#if RVAFT_PLACES
    m->events.count = 0;
    m->events.spare = 0;
#endif
}

/* @step */
/*@ requires \valid(m) && \valid_read(e) && \separated(m, e) && sound(m);
    assigns *m;
    ensures sound(m) && \result == outcome(m);
    behavior final:
        assumes outcome(m) != RVAFT_UNKNOWN;
        assigns \nothing;
        ensures \result == \old(outcome(m)); */
static int step(rvaft_monitor *m, const rvaft_event *e) {
    uint8_t matches[RVAFT_PATTERNS];
    int verdict = RVAFT_UNKNOWN;
    uint32_t i;
    if (m->error != 0) {
        return m->error;
    }
    if (m->verdict != RVAFT_UNKNOWN) {
        return m->verdict;
    }
    /*@ loop invariant 0 <= i <= RVAFT_FIELDS;
        loop assigns i, m->known[0 .. RVAFT_FIELDS - 1];
        loop variant RVAFT_FIELDS - i; */
    for (i = 0; i < RVAFT_FIELDS; i++) {
        if (e->field[i].tag == RVAFT_BIG && e->field[i].text == NULL) { /* a double of more than 64 bits */
            m->error = RVAFT_UNSUPPORTED;
            return m->error;
        }
        m->known[i] = 0;
    }
    m->number++;
    if (!is_late(m, e)) {
        match(matches, e);
        if (scattered(m, e, matches)) {
            verdict = RVAFT_TRUE;
        }
    }
    return decided(m, verdict);
}

/* @state */
/* Append bytes while there is room. */
static void put_state(char *to, size_t size, size_t *used, const void *from, size_t more) {
    if (*used + more <= size) {
        memcpy(to + *used, from, more);
    }
    *used += more;
}

/* Append matches of an instance: whether they are kept, and when they start. Returns whether one is. */
static int put_starts(const instance *r, uint32_t at, uint32_t count, char *to, size_t size, size_t *used) {
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

/* Append an instance; returns 0 if it has nothing. */
static int put_instance(const rvaft_monitor *m, const instance *r, uint32_t number, char *to, size_t size,
                        size_t *used) {
    uint32_t i, k;
    int some;
    (void)m;
    put_state(to, size, used, &number, sizeof number);
#if RVAFT_NAMED
    for (k = 0; k < kind_of(r)->names; k++) {
        const cell *c = &ROW(r->name, k);
        put_state(to, size, used, &c->tag, sizeof c->tag);
        if (c->tag >= RVAFT_BIG) {
            uint32_t length = m->texts.size[c->bits];
            put_state(to, size, used, &length, sizeof length);
            put_state(to, size, used, m->texts.bytes + m->texts.start[c->bits], length);
        } else {
            put_state(to, size, used, &c->bits, sizeof c->bits);
        }
    }
#endif
    some = put_starts(r, 0, ROW(kinds, number).slots, to, size, used);
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

/* The state as bytes: equal states have equal futures. Returns their number; writes at most `size`
   of them (at least 12). The greatest time and each instance are a record: its size, its bytes. */
RVAFT_API size_t rvaft_state(const rvaft_monitor *m, char *to, size_t size) {
    size_t used = 0, before;
    uint32_t i, record;
    if (m->has_latest && size >= 12) {
        record = sizeof m->latest;
        put_state(to, size, &used, &record, sizeof record);
        put_state(to, size, &used, &m->latest, sizeof m->latest);
    }
#if RVAFT_NAMED
    for (i = 0; i < m->instances.count; i++) {
        const instance *r = &m->instances.item[i];
        uint32_t number = r->kind;
        if (number == NONE || is_void(m, r)) {
            continue;
        }
#else
    for (i = 0; i < RVAFT_INSTANCES; i++) {
        const instance *r = &m->instances.item[i];
        uint32_t number = i;
#endif
        before = used;
        used += sizeof record;
        if (!put_instance(m, r, number, to, size, &used)) {
            used = before;
        } else if (used <= size) {
            record = (uint32_t)(used - before - sizeof record);
            memcpy(to + before, &record, sizeof record);
        }
    }
    return used;
}
