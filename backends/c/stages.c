/* @types */
#define MAX_LINKS RVAFT_LINKS
#define RVAFT_ENDS (RVAFT_ABSENCES || RVAFT_BY) /* whether a partial match may end by an event */

typedef struct partial {
    uint32_t next[MAX_LINKS];
    uint32_t stage;
#if RVAFT_KEYED
    uint32_t key; /* NONE before the first event */
    uint32_t era; /* of the key */
#endif
#if RVAFT_ENDS
    uint32_t ended; /* the tick of the event that broke it, or after which others began afresh, or 0 */
#endif
    cell slot[RVAFT_WIDTH];
#if RVAFT_PLACES
    uint32_t taken;
    place events[RVAFT_DEPTH];
#endif
} partial;

/* Partial matches with hash tables. The first has the partial matches that are equal except for
   times that can be compared; the others have those that one move concerns. */
typedef struct bucket {
    uint32_t head;
    uint32_t epoch; /* a bucket of another epoch is empty */
} bucket;

typedef struct store {
    uint32_t count;
    uint32_t epoch;
    uint32_t mask; /* of the buckets in use: fewer stay in the cache */
    bucket buckets[MAX_LINKS][RVAFT_BUCKETS];
    partial item[RVAFT_CAPACITY + 1]; /* the one after the last is being made */
} store;

#if RVAFT_REMEMBERED
/* An event that may not come before a part: its values, and its latest time. */
typedef struct past {
    uint32_t next;
    uint32_t number; /* in all_remembered */
#if RVAFT_KEYED
    uint32_t key;
    uint64_t birth; /* of the key: its place may be that of another one */
#endif
    int64_t latest;
    cell slot[RVAFT_PAST_WIDTH];
} past;
#endif

/* @members */
    uint32_t sweep_at;
    uint32_t now; /* the store with the partial matches */
    store stores[RVAFT_STORES];
#if RVAFT_ENDS
    uint32_t tick;  /* of the event, from 1 */
    uint32_t ended; /* whether a partial match that has ended is in the store */
#endif
#if RVAFT_WAITS
    int64_t earliest; /* no deadline is earlier */
#endif
#if RVAFT_REMEMBERED
    uint32_t pasts;
    uint32_t recalled;                 /* the one whose guard is evaluated */
    uint32_t past_head[RVAFT_BUCKETS]; /* one more than the first, or 0 */
    past past[RVAFT_PAST];
#endif
#if RVAFT_PLACES
    partial match; /* after a detection */
#endif

/* @rows */
typedef struct stage {
    uint32_t rank; /* a move leads to a lower rank; 0 detects */
    uint16_t slots;
    uint16_t exact; /* the first slots must be equal for one partial match to replace another */
    uint32_t move;  /* the first move */
    uint16_t moves;
    uint16_t links;
    uint32_t link;    /* the first list of slots in link_slots */
    uint32_t order;   /* in slot_order: 1 if a smaller time is better, else 0, after the exact slots */
    uint32_t expiry;  /* the first in expiries */
    uint32_t expires; /* the number of expiries */
#if RVAFT_ABSENCES
    uint32_t breaks; /* after the moves */
    uint32_t wait;   /* the first in waits */
    uint32_t waits;
#endif
} stage;

typedef struct move {
    uint32_t stage;
    uint32_t target;
    uint32_t pattern;
    uint32_t guard; /* 0: none */
    uint32_t load;  /* the first in loads, one for each slot of the target */
    uint32_t join;  /* the first in joins */
    uint16_t joins;
    uint16_t link;
#if RVAFT_REMEMBERED
    uint32_t recall; /* the first in recalls */
    uint32_t recalls;
#endif
} move;

enum { COPY, FIELD, NOW, LATEST, EARLIEST };

typedef struct load {
    uint8_t from;
    uint8_t slot;
    uint16_t field;
} load;

typedef struct join {
    uint16_t slot;
    uint16_t field;
} join;

typedef struct expiry {
    uint32_t slot;
    int64_t most;
} expiry;

#if RVAFT_WAITS
/* The next stage after a time that exceeds that of a slot by more than `most`. */
typedef struct wait {
    uint32_t slot;
    uint32_t target;
    uint32_t load;
    int64_t most;
} wait;

/* A time and a duration that is not negative; the greatest time stands for what needs more bits. */
static int64_t extended(int64_t time, int64_t more) { return time > INT64_MAX - more ? INT64_MAX : time + more; }

static int comes_by(const rvaft_event *e, rvaft_value end, int64_t more) {
    return e->has_time && end.tag == RVAFT_INTEGER && e->time <= extended(end.integer, more);
}
#endif

#if RVAFT_REMEMBERED
/* What must not have come before a move: the values of `load` are the first ones of a remembered event. */
typedef struct recall {
    uint32_t number;
    uint32_t guard;
    uint32_t load;
} recall;

typedef struct remembered {
    uint32_t pattern;
    uint32_t guard; /* of the event */
    uint32_t field; /* the first in link_slots */
    uint16_t fields;
    uint16_t joined;
    int64_t most; /* the duration, or -1 */
} remembered;

#define PAST(n) value_of(m, &m->past[m->recalled < RVAFT_PAST ? m->recalled : 0].slot[n])
#endif

/* @marks */
#if RVAFT_KEYED
#define KEY_OF(p) ((p)->key)
#define CURRENT_KEY(m) ((m)->key)
#define is_void(m, p) ((p)->key < RVAFT_KEYS && (m)->keys.item[(p)->key].era != (p)->era)
#define is_forgotten(m, p) ((p)->key < RVAFT_KEYS && (m)->keys.birth[(p)->key] != (p)->birth)
#else
#define KEY_OF(p) NONE
#define CURRENT_KEY(m) NONE
#define is_void(m, p) 0
#define is_forgotten(m, p) 0
#endif

static const stage *stage_of(const partial *p) { return &ROW(stages, p->stage); }

static const cell *slot_of(const partial *p, uint32_t n) { return &ROW(p->slot, n); }

static void mark_texts(rvaft_monitor *m) {
    uint32_t s, i, k;
    memset(m->texts.live, 0, sizeof m->texts.live);
    for (s = 0; s < RVAFT_STORES; s++) {
        for (i = 0; i < m->stores[s].count && i < RVAFT_CAPACITY; i++) {
            const partial *p = &m->stores[s].item[i];
            for (k = 0; k < stage_of(p)->slots && !is_void(m, p); k++) {
                mark_text(&m->texts, slot_of(p, k));
            }
        }
    }
#if RVAFT_REMEMBERED
    for (i = 0; i < m->pasts && i < RVAFT_PAST; i++) {
        for (k = 0; k < RVAFT_PAST_WIDTH && !is_forgotten(m, &m->past[i]); k++) {
            mark_text(&m->texts, &m->past[i].slot[k]);
        }
    }
#endif
    for (i = 0; i < RVAFT_FIELDS; i++) {
        if (m->known[i] == 2) {
            mark_text(&m->texts, &m->cells[i]);
        }
    }
}

/* @matches */
/* Stores. */

static void clear_store(store *s) {
    s->count = 0;
    s->mask = s->mask == 0 ? FEW : s->mask;
    s->epoch++;
    if (s->epoch == 0) {
        memset(s->buckets, 0, sizeof s->buckets);
        s->epoch = 1;
    }
}

#if RVAFT_ENDS
#define IS_BROKEN(p) ((p)->ended != 0)
/* An event still extends the partial matches that it breaks. */
#define WAS_BROKEN(m, p) ((p)->ended != 0 && (p)->ended != (m)->tick)
#else
#define IS_BROKEN(p) 0
#define WAS_BROKEN(m, p) 0
#endif

/* The place of a partial match in a hash table depends on its stage, some of its cells, and its key. */
static uint64_t hash_of(uint32_t stage_number, uint32_t link) { return (uint64_t)stage_number << 32 | link; }

static uint64_t hash_with(uint64_t h, const cell *c) {
    h = (h ^ c->hash) * UINT64_C(0xD6E8FEB86659FD93);
    return h ^ h >> 32;
}

static uint32_t bucket_of(const store *s, uint64_t h, uint32_t key) {
    h = (h ^ (uint64_t)(key + 1U) << 32) * UINT64_C(0x9E3779B97F4A7C15);
    return (uint32_t)(h >> 32 ^ h >> 61) & s->mask & (RVAFT_BUCKETS - 1);
}

static uint32_t first_in(const store *s, uint32_t link, uint32_t place) {
    const bucket *b = &ROW(s->buckets, link)[place];
    return b->epoch == s->epoch ? b->head : NONE;
}

static void link_at(store *s, uint32_t number, uint32_t link, uint32_t home) {
    s->item[number].next[link] = first_in(s, link, home);
    s->buckets[link][home].head = number;
    s->buckets[link][home].epoch = s->epoch;
}

/* The place in the first table, of all exact slots. */
static uint32_t first_place(const store *s, const partial *p) {
    uint64_t h = hash_of(p->stage, 0);
    uint32_t i;
    for (i = 0; i < stage_of(p)->exact; i++) {
        h = hash_with(h, slot_of(p, i));
    }
    return bucket_of(s, h, KEY_OF(p));
}

#if RVAFT_BY
#define BY_LINK (MAX_LINKS - 1U)

/* The place of the partial matches of all stages that have a value of the variable of repetition. */
static uint32_t by_place(const store *s, const cell *value, uint32_t key) {
    return bucket_of(s, hash_with(hash_of(NONE, BY_LINK), value), key);
}
#endif

/* Put a partial match, whose place in the first table is known, into all tables. */
static void link_partial(store *s, uint32_t number, uint32_t home) {
    const partial *p = &s->item[number];
    const stage *st = stage_of(p);
    uint32_t link, at = st->link + 1 + st->exact;
    link_at(s, number, 0, home);
#if RVAFT_BY
    if (ROW(by_slots, p->stage) != NONE) {
        link_at(s, number, BY_LINK, by_place(s, slot_of(p, ROW(by_slots, p->stage)), KEY_OF(p)));
    }
#endif
    for (link = 1; link < st->links && link < MAX_LINKS; link++) {
        uint32_t stop = at + 1 + ROW(link_slots, at);
        uint64_t h = hash_of(p->stage, link);
        for (at++; at < stop; at++) {
            h = hash_with(h, slot_of(p, ROW(link_slots, at)));
        }
        link_at(s, number, link, bucket_of(s, h, KEY_OF(p)));
    }
}

static int same_cell(const cell *a, const cell *b) { return a->tag == b->tag && a->bits == b->bits; }

/* Compare two partial matches of a stage with equal exact slots: 1 if `p` is at least as good as
   `q`, -1 if `q` is better, else 0. */
static int better(const stage *st, const partial *p, const partial *q) {
    uint32_t i;
    int p_good = 1, q_good = 1;
    for (i = st->exact; i < st->slots; i++) {
        int64_t a = slot_of(p, i)->bits, b = slot_of(q, i)->bits;
        if (a != b) {
            int p_wins = ROW(slot_order, st->order + i - st->exact) ? a < b : a > b;
            p_good = p_good && p_wins;
            q_good = q_good && !p_wins;
        }
    }
    return p_good ? 1 : q_good ? -1 : 0;
}

/* The partial match that is being made. */
static partial *next_partial(store *s) { return &s->item[s->count < RVAFT_CAPACITY ? s->count : RVAFT_CAPACITY]; }

#if RVAFT_PLACES
/* Copy the places of the events; returns their number, with which one more has room. */
static uint32_t copy_places(partial *to, const partial *from) {
    uint32_t i;
    for (i = 0; i < from->taken && i + 1 < RVAFT_DEPTH; i++) {
        place moved = from->events[i];
        to->events[i] = moved;
    }
    return i;
}
#endif

#if RVAFT_WAITS
static int64_t deadline(const partial *p, uint32_t number) {
    const wait *w = &ROW(waits, number);
    return extended(slot_of(p, w->slot)->bits, w->most);
}

static void note_deadlines(rvaft_monitor *m, const partial *p) {
    const stage *st = stage_of(p);
    uint32_t i;
    for (i = 0; i < st->waits; i++) {
        int64_t time = deadline(p, st->wait + i);
        m->earliest = time < m->earliest ? time : m->earliest;
    }
}
#endif

/* Keep the partial match that has been made, unless another one is at least as good. */
static void insert_partial(rvaft_monitor *m, store *s) {
    const partial *p = next_partial(s);
    const stage *st = stage_of(p);
    uint32_t i, home = first_place(s, p), at = first_in(s, 0, home);
#if RVAFT_WAITS
    note_deadlines(m, p);
#endif
    for (; at < RVAFT_CAPACITY; at = s->item[at].next[0]) {
        partial *other = &s->item[at];
        if (other->stage == p->stage && KEY_OF(other) == KEY_OF(p) && !is_void(m, other) && !IS_BROKEN(other)) {
            int equal = 1, order;
            for (i = 0; equal && i < st->exact; i++) {
                equal = same_cell(slot_of(p, i), slot_of(other, i));
            }
            if (equal) {
                order = better(st, other, p);
                if (order > 0) {
                    return;
                }
                if (order < 0) {
                    for (i = st->exact; i < st->slots && i < RVAFT_WIDTH; i++) {
                        cell moved = p->slot[i];
                        other->slot[i] = moved;
                    }
#if RVAFT_PLACES
                    other->taken = copy_places(other, p);
#endif
                    return;
                }
            }
        }
    }
    at = s->count;
    if (at >= RVAFT_CAPACITY) {
        m->error = RVAFT_FULL;
        return;
    }
    link_partial(s, at, home);
    s->count = at + 1;
}

/*@ assigns *m, *s; */
static void insert_starts(rvaft_monitor *m, store *s) {
    uint32_t i;
    for (i = 0; i < RVAFT_STARTS; i++) {
        partial *p = next_partial(s);
        p->stage = starts[i];
#if RVAFT_KEYED
        p->key = NONE;
        p->era = 0;
#endif
#if RVAFT_ENDS
        p->ended = 0;
#endif
#if RVAFT_PLACES
        p->taken = 0;
#endif
        insert_partial(m, s);
    }
}

/* Whether an event has the values of a partial match that a move compares, and the guard holds. */
static int agrees(rvaft_monitor *m, const partial *p, const move *mv, const rvaft_event *e) {
    uint32_t i;
    for (i = 0; i < mv->joins; i++) {
        const join *j = &ROW(joins, mv->join + i);
        const cell *c = cell_of(m, e, j->field, 0);
        if (c->tag == RVAFT_UNDEFINED || !same_cell(c, slot_of(p, j->slot))) {
            return 0;
        }
    }
    return mv->guard == 0 || (guard(m, mv->guard, p->slot, e) && m->error == 0);
}

#if RVAFT_REMEMBERED
static int has_expired(int64_t latest, uint64_t latenesses, const past *one) {
    int64_t most = ROW(all_remembered, one->number).most;
    return RVAFT_LATE >= 0 && most >= 0 && latest > one->latest &&
           (uint64_t)latest - (uint64_t)one->latest > (uint64_t)most + latenesses * lateness();
}

static uint64_t past_hash(uint32_t number) { return ((uint64_t)number + 1) * UINT64_C(0x9E3779B97F4A7C15); }

static uint32_t *past_bucket(rvaft_monitor *m, uint64_t h, uint32_t key) {
    h = (h ^ (uint64_t)(key + 1U) << 32) * UINT64_C(0x9E3779B97F4A7C15);
    return &m->past_head[(uint32_t)(h >> 32 ^ h >> 61) & (RVAFT_BUCKETS - 1)];
}

/* Remove the remembered events that are too old. */
static void forget_past(rvaft_monitor *m) {
    uint32_t i, k, kept = 0;
    memset(m->past_head, 0, sizeof m->past_head);
    for (i = 0; i < m->pasts && i < RVAFT_PAST; i++) {
#if RVAFT_KEYED
        int64_t latest = ROW(m->keys.item, m->past[i].key).latest;
#else
        int64_t latest = m->latest;
#endif
        if (!has_expired(latest, 1, &m->past[i]) && !is_forgotten(m, &m->past[i])) {
            past moved = m->past[i];
            uint64_t h = past_hash(moved.number);
            uint32_t *head, joined = ROW(all_remembered, moved.number).joined;
            for (k = 0; k < joined && k < RVAFT_PAST_WIDTH; k++) {
                h = hash_with(h, &moved.slot[k]);
            }
#if RVAFT_KEYED
            head = past_bucket(m, h, moved.key);
#else
            head = past_bucket(m, h, NONE);
#endif
            moved.next = *head;
            m->past[kept] = moved;
            *head = ++kept;
        }
    }
    m->pasts = kept;
}

/* Remember an event by its values. */
static void remember_as(rvaft_monitor *m, const rvaft_event *e, uint32_t number) {
    const remembered *r = &ROW(all_remembered, number);
    uint64_t h = past_hash(number);
    uint32_t k, at, *head;
    past made = {0};
    if ((r->most >= 0 && !e->has_time) || (r->guard != 0 && (!guard(m, r->guard, NULL, e) || m->error != 0))) {
        return;
    }
    if (m->pasts >= RVAFT_PAST) { /* before a text needs room */
        forget_past(m);
    }
    made.number = number;
    made.latest = e->has_time ? e->time : 0;
#if RVAFT_KEYED
    made.key = m->key;
    made.birth = ROW(m->keys.birth, m->key);
#endif
    for (k = 0; k < r->fields && k < RVAFT_PAST_WIDTH; k++) {
        made.slot[k] = *cell_of(m, e, ROW(link_slots, r->field + k), 1);
        if (k < r->joined) {
            if (made.slot[k].tag == RVAFT_UNDEFINED) {
                return;
            }
            h = hash_with(h, &made.slot[k]);
        }
    }
    if (m->error != 0) {
        return;
    }
    head = past_bucket(m, h, CURRENT_KEY(m));
    for (at = *head; at > 0 && at <= RVAFT_PAST; at = m->past[at - 1].next) {
        past *other = &m->past[at - 1];
        int equal = other->number == number;
#if RVAFT_KEYED
        equal = equal && other->key == m->key && !is_forgotten(m, other);
#endif
        for (k = 0; equal && k < r->fields && k < RVAFT_PAST_WIDTH; k++) {
            equal = same_cell(&made.slot[k], &other->slot[k]);
        }
        if (equal) {
            other->latest = made.latest > other->latest ? made.latest : other->latest;
            return;
        }
    }
    at = m->pasts;
    if (at >= RVAFT_PAST) {
        m->error = RVAFT_FULL;
        return;
    }
    made.next = *head;
    m->past[at] = made;
    m->pasts = at + 1;
    *head = at + 1;
}

static void remember(rvaft_monitor *m, const rvaft_event *e, const uint8_t *matches) {
    uint32_t i;
    for (i = 0; i < RVAFT_REMEMBERED; i++) {
        if (matches[ROW(all_remembered, i).pattern] && m->error == 0) {
            remember_as(m, e, i);
        }
    }
}

/* Whether an event came that may not come before the event of a move. */
static int has_come(rvaft_monitor *m, const recall *r, const partial *p, const rvaft_event *e) {
    const remembered *kind = &ROW(all_remembered, r->number);
    const cell *wanted[RVAFT_PAST_WIDTH] = {NULL};
    uint64_t h = past_hash(r->number);
    uint32_t k, at;
    for (k = 0; k < kind->joined && k < RVAFT_PAST_WIDTH; k++) {
        const load *l = &ROW(loads, r->load + k);
        wanted[k] = l->from == FIELD ? cell_of(m, e, l->field, 0) : slot_of(p, l->slot);
        h = hash_with(h, wanted[k]);
    }
    at = *past_bucket(m, h, CURRENT_KEY(m));
    for (; at > 0 && at <= RVAFT_PAST && m->error == 0; at = m->past[at - 1].next) {
        const past *one = &m->past[at - 1];
        int equal = one->number == r->number;
#if RVAFT_KEYED
        equal = equal && one->key == m->key && !is_forgotten(m, one);
#endif
        for (k = 0; equal && k < kind->joined && k < RVAFT_PAST_WIDTH; k++) {
            equal = wanted[k] != NULL && same_cell(&one->slot[k], wanted[k]);
        }
        if (equal && kind->most >= 0) {
            equal = one->latest >= e->time || (uint64_t)e->time - (uint64_t)one->latest <= (uint64_t)kind->most;
        }
        m->recalled = at - 1;
        if (equal && (r->guard == 0 || guard(m, r->guard, p->slot, e)) && m->error == 0) {
            return 1;
        }
    }
    return 0;
}
#endif

/* Try a move from a partial match; returns 1 if it detects. */
static int try_move(rvaft_monitor *m, store *to, const partial *p, const move *mv, const rvaft_event *e) {
    partial *made = next_partial(to);
    const stage *st = &ROW(stages, mv->target);
    uint32_t i;
    if (!agrees(m, p, mv, e)) {
        return 0;
    }
#if RVAFT_REMEMBERED
    for (i = 0; i < mv->recalls; i++) {
        if (has_come(m, &ROW(recalls, mv->recall + i), p, e) || m->error != 0) {
            return 0;
        }
    }
#endif
#if RVAFT_PLACES
    made = st->rank == 0 ? &m->match : made;
    i = copy_places(made, p);
    made->events[i] = e->at;
    made->taken = i + 1;
#endif
    if (st->rank == 0) {
        return m->error == 0;
    }
    made->stage = mv->target;
#if RVAFT_ENDS
    made->ended = 0;
#endif
#if RVAFT_KEYED
    made->key = m->key;
    made->era = ROW(m->keys.item, m->key).era;
#endif
    for (i = 0; i < st->slots && i < RVAFT_WIDTH; i++) {
        const load *l = &ROW(loads, mv->load + i);
        cell *c = &made->slot[i];
        rvaft_value t;
        if (l->from == COPY) {
            *c = *slot_of(p, l->slot);
            continue;
        }
        if (l->from == FIELD) {
            *c = *cell_of(m, e, l->field, 1);
            continue;
        }
        t = AT;
        if (l->from != NOW) {
            rvaft_value before = value_of(m, slot_of(p, l->slot));
            t = l->from == LATEST ? later(before, t) : earlier(before, t);
        }
        c->tag = t.tag;
        c->bits = t.integer;
        if (i < st->exact) {
            c->hash = mixed(((uint64_t)c->bits ^ m->seed ^ c->tag) * UINT64_C(0x9E3779B97F4A7C15));
        }
    }
    for (i = st->exact; i < st->slots; i++) {
        if (slot_of(made, i)->tag == RVAFT_UNDEFINED) { /* a guard over this time can never hold */
            return 0;
        }
    }
    if (m->error == 0) {
        insert_partial(m, to);
    }
    return 0;
}

#if RVAFT_SCATTERED

#if RVAFT_EXPIRIES
/* Whether no later event can complete a partial match in time, by the greatest time so far. */
static int expired(int64_t latest, uint64_t latenesses, const partial *p) {
    const stage *st = stage_of(p);
    uint32_t i;
    for (i = 0; i < st->expires; i++) {
        const expiry *x = &ROW(expiries, st->expiry + i);
        int64_t from = slot_of(p, x->slot)->bits;
        if (latest > from && (uint64_t)latest - (uint64_t)from > (uint64_t)x->most + latenesses * lateness()) {
            return 1;
        }
    }
    return 0;
}
#else
#define expired(latest, latenesses, p) 0
#endif

#if RVAFT_KEYED
/* Mark the keys with a partial match, or an event that may not come before one, that still matters by the
   greatest time of all keys. */
static void mark_keys(rvaft_monitor *m) {
    const store *s = &m->stores[0];
    uint32_t i;
    for (i = 0; i < s->count && i < RVAFT_CAPACITY; i++) {
        const partial *p = &s->item[i];
        if (p->key < RVAFT_KEYS && !is_void(m, p) && !IS_BROKEN(p) && !expired(m->keys.newest, 2, p)) {
            m->keys.live[p->key] = 1;
        }
    }
#if RVAFT_REMEMBERED
    for (i = 0; i < m->pasts && i < RVAFT_PAST; i++) {
        if (!is_forgotten(m, &m->past[i]) && !has_expired(m->keys.newest, 2, &m->past[i])) {
            ROW(m->keys.live, m->past[i].key) = 1;
        }
    }
#endif
}
#endif

/* Remove the partial matches that no further event can complete; returns how many are left. */
static uint32_t drop_partials(rvaft_monitor *m, store *s) {
    uint32_t i, kept = 0, count = s->count;
    for (i = 0; i < count && i < RVAFT_CAPACITY; i++) {
        const partial *p = &s->item[i];
#if RVAFT_KEYED
        const int64_t latest = ROW(m->keys.item, p->key).latest; /* with slots it has a key */
#else
        const int64_t latest = m->latest;
#endif
        (void)latest;
        (void)p;
        if ((m->has_latest && expired(latest, 1, p)) || is_void(m, p) || IS_BROKEN(p)) {
            continue;
        }
        if (kept < i) {
            partial moved = s->item[i];
            s->item[kept] = moved;
        }
        kept++;
    }
    s->count = kept;
    return kept;
}

/* Remove the partial matches that no further event can complete in time, and adapt the number of
   buckets; again when there are twice as many, so that the work per event stays bounded. Keys are
   forgotten rather than that there is no room. */
static void sweep(rvaft_monitor *m, store *s) {
    uint32_t i, kept = drop_partials(m, s);
#if RVAFT_KEYED
    if (kept > RVAFT_CAPACITY - RVAFT_CAPACITY / 8 && forget_keys(m, RVAFT_KEYS)) {
        kept = drop_partials(m, s);
    }
#endif
    while (s->mask < RVAFT_BUCKETS - 1 && s->mask < 4 * kept) {
        s->mask = s->mask * 2 + 1;
    }
    clear_store(s);
    for (i = 0; i < kept && i < RVAFT_CAPACITY; i++) {
        link_partial(s, i, first_place(s, &s->item[i]));
    }
    s->count = kept;
    m->sweep_at = kept < FEW ? 2 * FEW : kept < RVAFT_CAPACITY / 2 ? 2 * kept : kept + (RVAFT_CAPACITY - kept) / 2;
    m->sweep_at = m->sweep_at < RVAFT_CAPACITY ? m->sweep_at : RVAFT_CAPACITY - RVAFT_CAPACITY / 8;
#if RVAFT_ENDS
    m->ended = 0;
#endif
}

/* The hash of the partial matches that a move concerns, in the table of the move. */
static uint64_t hash_of_move(rvaft_monitor *m, const move *mv, const rvaft_event *e) {
    uint32_t slot = ROW(stages, mv->stage).link, k, last;
    uint64_t h = hash_of(mv->stage, mv->link);
    for (k = 0; k < mv->link; k++) {
        slot += 1U + ROW(link_slots, slot);
    }
    last = slot + ROW(link_slots, slot);
    for (; slot < last; slot++) {
        uint32_t join = mv->join;
        while (join + 1 < mv->join + mv->joins && ROW(joins, join).slot != ROW(link_slots, slot + 1)) {
            join++;
        }
        h = hash_with(h, cell_of(m, e, ROW(joins, join).field, 0));
    }
    return h;
}

#if RVAFT_BY
/* End the partial matches that have a value of the variable of repetition. */
static void restart(rvaft_monitor *m, store *s, const cell *value) {
    uint32_t at = first_in(s, BY_LINK, by_place(s, value, CURRENT_KEY(m)));
    for (; at < RVAFT_CAPACITY; at = ROW(s->item[at].next, BY_LINK)) {
        partial *p = &s->item[at];
        const uint32_t slot = ROW(by_slots, p->stage);
        if (slot != NONE && KEY_OF(p) == CURRENT_KEY(m) && !IS_BROKEN(p) && same_cell(slot_of(p, slot), value)) {
            p->ended = m->tick;
            m->ended = 1;
        }
    }
}

/* The value that an event has in a pattern for the variable of repetition. */
static const cell *by_value(rvaft_monitor *m, const rvaft_event *e, uint32_t pattern) {
    return cell_of(m, e, ROW(by_fields, pattern), 0);
}

/* End the partial matches with a value of an event that has detected. */
static void restart_detected(rvaft_monitor *m, store *s, const rvaft_event *e, const uint8_t *detected) {
    uint32_t i;
    for (i = 0; i < RVAFT_PATTERNS; i++) {
        if (detected[i] && by_value(m, e, i)->tag != RVAFT_UNDEFINED) {
            restart(m, s, by_value(m, e, i));
        }
    }
}

#define DETECTED(pattern) (detected[pattern] = 1, some = 1)
#else
#define DETECTED(pattern) return 1
#endif

/* Try all moves of a pattern, or of several in the order of ranks, so that no event is used twice. Returns whether
   one detects; with RVAFT_BY it notes the patterns of those that do, and tries all. */
/*@ assigns *m, detected[0 .. RVAFT_PATTERNS - 1]; */
static int scattered(rvaft_monitor *m, const rvaft_event *e, const uint32_t *matched, uint32_t count,
                     uint8_t *detected) {
    store *s = &m->stores[0];
    uint32_t cursor[RVAFT_PATTERNS] = {0}, i;
    int some = 0;
    (void)detected;
    for (i = 0; i < count && i < RVAFT_PATTERNS; i++) {
        cursor[i] = ROW(pattern_moves, matched[i]);
    }
    for (;;) {
        uint32_t best = 0, rank = NONE, at, key = NONE;
        const move *mv;
        uint64_t h;
        for (i = 0; count > 1 && i < count && i < RVAFT_PATTERNS; i++) {
            uint32_t next = cursor[i];
            if (next < ROW(pattern_moves, matched[i] + 1) && next < RVAFT_MOVES) {
                uint32_t its = ROW(stages, ROW(moves, sorted_moves[next]).stage).rank;
                if (its < rank) {
                    rank = its;
                    best = i;
                }
            }
        }
        at = cursor[best];
        if (at >= ROW(pattern_moves, matched[best] + 1) || at >= RVAFT_MOVES) {
            return some; /* no pattern has another move */
        }
        cursor[best] = at + 1;
        mv = &ROW(moves, sorted_moves[at]);
        h = hash_of_move(m, mv, e);
        for (;;) { /* those without an event, and those of the key */
            at = first_in(s, mv->link, bucket_of(s, h, key));
            while (at < RVAFT_CAPACITY && m->error == 0) {
                const partial *p = &s->item[at];
                at = ROW(p->next, mv->link);
                if (p->stage == mv->stage && KEY_OF(p) == key && !is_void(m, p) && !WAS_BROKEN(m, p) &&
                    try_move(m, s, p, mv, e)) {
                    DETECTED(mv->pattern);
                }
            }
            if (m->error != 0) {
                return 0;
            }
            if (key == CURRENT_KEY(m)) {
                break;
            }
            key = CURRENT_KEY(m);
        }
    }
}

#else

/* Replace the partial matches by those that the event extends. */
/*@ assigns *m; */
static int replaced(rvaft_monitor *m, const rvaft_event *e, const uint8_t *matches) {
    store *from = &m->stores[m->now], *to = &m->stores[1 - m->now];
    uint32_t i, k;
    clear_store(to);
    for (i = 0; i < from->count && i < RVAFT_CAPACITY; i++) {
        const partial *p = &from->item[i];
        const stage *st = stage_of(p);
        if (WAS_BROKEN(m, p)) {
            continue;
        }
        for (k = 0; k < st->moves; k++) {
            const move *mv = &ROW(moves, st->move + k);
            if (matches[mv->pattern]) {
                if (try_move(m, to, p, mv, e)) {
                    return 1;
                }
                if (m->error != 0) {
                    return 0;
                }
            }
        }
    }
#if RVAFT_WAITS
    for (i = 0; i < from->count && i < RVAFT_CAPACITY && m->error == 0; i++) { /* matches wait on */
        const partial *p = &from->item[i];
        if (stage_of(p)->moves == 0 && stage_of(p)->waits != 0 && !IS_BROKEN(p)) {
            partial waiting = *p;
            *next_partial(to) = waiting;
            insert_partial(m, to);
        }
    }
#endif
    m->now = 1 - m->now;
    return 0;
}

#endif

#if RVAFT_ENDS
/* Keep only the partial matches that are not broken, and none twice. */
static void rebuild(rvaft_monitor *m, store *s) {
    uint32_t i, count = s->count;
    clear_store(s);
    for (i = 0; i < count && i < RVAFT_CAPACITY; i++) {
        if (!is_void(m, &s->item[i]) && !IS_BROKEN(&s->item[i])) {
            partial moved = s->item[i];
            *next_partial(s) = moved;
            insert_partial(m, s);
        }
    }
    m->ended = 0;
}
#endif

#if RVAFT_ABSENCES
/* Note which partial matches an event breaks. */
static void break_open(rvaft_monitor *m, store *s, const rvaft_event *e, const uint8_t *matches) {
    uint32_t at;
#if RVAFT_SCATTERED
    uint32_t i, pattern;
    for (pattern = 0; pattern < RVAFT_PATTERNS; pattern++) {
        for (i = ROW(pattern_breaks, pattern); matches[pattern] && i < ROW(pattern_breaks, pattern + 1); i++) {
            const move *mv = &ROW(moves, ROW(sorted_breaks, i));
            at = first_in(s, mv->link, bucket_of(s, hash_of_move(m, mv, e), CURRENT_KEY(m)));
            while (at < RVAFT_CAPACITY && m->error == 0) {
                partial *p = &s->item[at];
                at = ROW(p->next, mv->link);
                if (p->stage == mv->stage && KEY_OF(p) == CURRENT_KEY(m) && !is_void(m, p) && !IS_BROKEN(p) &&
                    agrees(m, p, mv, e)) {
                    p->ended = m->tick;
                    m->ended = 1;
                }
            }
        }
    }
#else
    for (at = 0; at < s->count && at < RVAFT_CAPACITY && m->error == 0; at++) {
        partial *p = &s->item[at];
        const stage *st = stage_of(p);
        uint32_t k;
        for (k = st->moves; k < st->moves + st->breaks && !IS_BROKEN(p); k++) {
            const move *mv = &ROW(moves, st->move + k);
            if (matches[mv->pattern] && agrees(m, p, mv, e)) {
                p->ended = m->tick;
                m->ended = 1;
            }
        }
    }
#endif
}

#if RVAFT_WAITS
#if RVAFT_BY
/* End the partial matches with the value of one that is complete, and note where an event has it, too. */
static void complete(rvaft_monitor *m, store *s, partial *p, const rvaft_event *e, const uint8_t *matches,
                     uint8_t *detected) {
    const cell value = *slot_of(p, ROW(by_slots, p->stage));
    uint32_t i;
    p->ended = m->tick;
    m->ended = 1;
    if (value.tag == RVAFT_UNDEFINED) {
        return;
    }
    restart(m, s, &value);
    for (i = 0; e != NULL && i < RVAFT_PATTERNS; i++) {
        detected[i] |= matches[i] && same_cell(by_value(m, e, i), &value);
    }
}
#endif

/* Decide the clauses whose deadline is before the time of an event, or without one (NULL) before a time; returns 1
   if a match is then complete. */
static int decide(rvaft_monitor *m, store *s, int64_t time, const rvaft_event *e, const uint8_t *matches,
                  uint8_t *detected) {
    uint32_t i, k, w;
    int moved = 0, some = 0;
    (void)e;
    (void)matches;
    (void)detected;
    if (time <= m->earliest) {
        return 0;
    }
    m->earliest = INT64_MAX;
    for (i = 0; i < s->count && i < RVAFT_CAPACITY; i++) {
        partial *p = &s->item[i];
        for (w = 0; !IS_BROKEN(p) && w < stage_of(p)->waits;) {
            const uint32_t number = stage_of(p)->wait + w;
            const wait *one = &ROW(waits, number);
            partial old;
            if (time <= deadline(p, number)) {
                w++;
                continue;
            }
            if (ROW(stages, one->target).rank == 0) {
#if RVAFT_PLACES
                m->match.taken = copy_places(&m->match, p);
#endif
#if RVAFT_BY
                some = 1;
                complete(m, s, p, e, matches, detected);
                break;
#else
                return 1;
#endif
            }
            old = *p;
            p->stage = one->target;
            for (k = 0; k < stage_of(p)->slots && k < RVAFT_WIDTH; k++) {
                p->slot[k] = *slot_of(&old, ROW(loads, one->load + k).slot);
            }
            moved = 1;
            w = 0;
        }
        if (!IS_BROKEN(p)) {
            note_deadlines(m, p);
        }
    }
    if (moved) {
        rebuild(m, s);
    }
    return some;
}
#endif

#endif

/* @follow */
#if RVAFT_SCATTERED
/* Whether there are so many partial matches that those of no use should be removed. */
static int is_crowded(const rvaft_monitor *m, const store *s) {
#if RVAFT_ENDS
    if (m->ended && s->count > RVAFT_CAPACITY - RVAFT_CAPACITY / 4) {
        return 1;
    }
#endif
    return s->count > m->sweep_at;
}
#endif

/* The verdict after an event: it decides clauses, breaks partial matches, and extends those before it. */
/*@ requires \valid(m) && \valid_read(e) && \separated(m, e);
    assigns *m; */
static int follow(rvaft_monitor *m, const rvaft_event *e, int late) {
    uint8_t matches[RVAFT_PATTERNS];
    uint8_t detected[RVAFT_PATTERNS] = {0};
    int verdict = RVAFT_UNKNOWN;
    uint32_t i;
#if RVAFT_ENDS
    store *s = &ROW(m->stores, m->now);
#endif
#if RVAFT_SCATTERED
    uint32_t matched[RVAFT_PATTERNS] = {0}, count = 0;
#endif
    (void)detected;
#if RVAFT_PROJECTS && !RVAFT_ABSENCES
    if (late || !relevant(&m->error, e)) {
        return RVAFT_UNKNOWN;
    }
#endif
    if (late) {
        /*@ loop invariant 0 <= i <= RVAFT_PATTERNS;
            loop assigns i, matches[0 .. RVAFT_PATTERNS - 1];
            loop variant RVAFT_PATTERNS - i; */
        for (i = 0; i < RVAFT_PATTERNS; i++) {
            matches[i] = 0;
        }
    } else {
        match(matches, e);
    }
#if RVAFT_SCATTERED
    /*@ loop invariant 0 <= count <= i <= RVAFT_PATTERNS;
        loop assigns i, count, matched[0 .. RVAFT_PATTERNS - 1];
        loop variant RVAFT_PATTERNS - i; */
    for (i = 0; i < RVAFT_PATTERNS; i++) {
        if (matches[i]) {
            matched[count++] = i;
        }
    }
    if ((RVAFT_ABSENCES || count != 0) && is_crowded(m, &m->stores[0])) {
        sweep(m, &m->stores[0]);
    }
#endif
#if RVAFT_ENDS
    m->tick++;
    if (m->tick == 0) {
        rebuild(m, s);
        m->tick = 1;
    }
#endif
#if RVAFT_WAITS
    if (e->has_time && decide(m, s, e->time, e, matches, detected)) {
        verdict = RVAFT_TRUE;
    }
#endif
#if RVAFT_ABSENCES
    if ((RVAFT_BY || verdict == RVAFT_UNKNOWN) && !late) {
        break_open(m, s, e, matches);
    }
#endif
#if RVAFT_SCATTERED
    if ((RVAFT_BY || verdict == RVAFT_UNKNOWN) && m->error == 0 && count != 0 &&
        scattered(m, e, matched, count, detected)) {
        verdict = RVAFT_TRUE;
    }
#if RVAFT_BY
    if (verdict == RVAFT_TRUE && m->error == 0) {
        restart_detected(m, s, e, detected);
    }
#endif
#else
#if RVAFT_PROJECTS && RVAFT_ABSENCES
    if (late || !relevant(&m->error, e)) {
        if (m->ended) {
            rebuild(m, s);
        }
    } else
#endif
    if (verdict == RVAFT_UNKNOWN && m->error == 0 && replaced(m, e, matches)) {
        verdict = RVAFT_TRUE;
    }
#if RVAFT_CONSECUTIVE
    if (verdict == RVAFT_UNKNOWN && m->error == 0) {
        insert_starts(m, &ROW(m->stores, m->now));
    }
#else
    if (verdict == RVAFT_UNKNOWN && ROW(m->stores, m->now).count == 0) {
        verdict = RVAFT_FALSE;
    }
#endif
#endif
#if RVAFT_REMEMBERED
    if (!late && m->error == 0) {
        remember(m, e, matches);
    }
#endif
    return verdict;
}

#if RVAFT_WAITS
/* Whether a match is complete at the end of the trace. */
static int is_whole(rvaft_monitor *m) {
    const store *s = &ROW(m->stores, m->now);
    uint32_t i;
    for (i = 0; i < s->count && i < RVAFT_CAPACITY; i++) {
        const partial *p = &s->item[i];
        if (stage_of(p)->moves == 0 && stage_of(p)->waits != 0 && !IS_BROKEN(p)) {
#if RVAFT_PLACES
            m->match.taken = copy_places(&m->match, p);
#endif
            return 1;
        }
    }
    return 0;
}

/* Whether a match is complete after a time. */
static int is_decided(rvaft_monitor *m, int64_t time) {
    return decide(m, &ROW(m->stores, m->now), time, NULL, NULL, NULL);
}
#endif

/* @begin */
static void begin(rvaft_monitor *m) {
    m->sweep_at = RVAFT_CAPACITY < 2 * FEW ? RVAFT_CAPACITY - RVAFT_CAPACITY / 8 : 2 * FEW;
    m->now = 0;
#if RVAFT_ENDS
    m->ended = 0;
#endif
#if RVAFT_WAITS
    m->earliest = INT64_MAX;
#endif
    clear_store(&m->stores[0]);
    insert_starts(m, &m->stores[0]);
}

/* @state */
static uint32_t size_of_cell(const rvaft_monitor *m, const cell *c) {
    return c->tag >= RVAFT_BIG ? 8U + m->texts.size[c->bits] : 12U;
}

/* Write a cell as bytes; returns their number. */
static uint32_t write_cell(const rvaft_monitor *m, const cell *c, char *to) {
    memcpy(to, &c->tag, 4);
    if (c->tag >= RVAFT_BIG) {
        uint32_t length = m->texts.size[c->bits];
        memcpy(to + 4, &length, 4);
        memcpy(to + 8, m->texts.bytes + m->texts.start[c->bits], length);
        return 8 + length;
    }
    memcpy(to + 4, &c->bits, 8);
    return 12;
}

/* The state as bytes: equal states have equal futures. Returns their number; writes at most `size`
   of them (at least 12). The greatest time and each partial match are a record: its size, its bytes. */
RVAFT_API size_t rvaft_state(const rvaft_monitor *m, char *to, size_t size) {
    const store *s = &m->stores[m->now];
    size_t used = 0;
    uint32_t i, k;
    if (m->has_latest && size >= 12) {
        uint32_t record = sizeof m->latest;
        memcpy(to, &record, sizeof record);
        memcpy(to + 4, &m->latest, sizeof m->latest);
        used = 12;
    }
#if RVAFT_REMEMBERED
    for (i = 0; i < m->pasts; i++) {
        const past *one = &m->past[i];
        uint32_t values = ROW(all_remembered, one->number).fields, record = 13;
        for (k = 0; k < values; k++) {
            record += size_of_cell(m, &one->slot[k]);
        }
        if (used + sizeof record + record <= size) {
            memcpy(to + used, &record, sizeof record);
            to[used + 4] = 'p';
            memcpy(to + used + 5, &one->number, 4);
            memcpy(to + used + 9, &one->latest, 8);
            used += 17;
            for (k = 0; k < values; k++) {
                used += write_cell(m, &one->slot[k], to + used);
            }
        } else {
            used += sizeof record + record;
        }
    }
#endif
    for (i = 0; i < s->count; i++) {
        const partial *p = &s->item[i];
        uint32_t record = (uint32_t)sizeof p->stage;
        if (IS_BROKEN(p)) {
            continue;
        }
        for (k = 0; k < stage_of(p)->slots; k++) {
            record += size_of_cell(m, &p->slot[k]);
        }
        if (used + sizeof record + record <= size) {
            memcpy(to + used, &record, sizeof record);
            memcpy(to + used + 4, &p->stage, 4);
            used += 8;
            for (k = 0; k < stage_of(p)->slots; k++) {
                used += write_cell(m, &p->slot[k], to + used);
            }
        } else {
            used += sizeof record + record;
        }
    }
    return used;
}
