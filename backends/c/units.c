/* @types */
/* What is known of the events with one value of the key of a unit. The events of a leaf with `times` and
   variables of its own are an instance, too. */
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
    kept kept;
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
/* Events of matches: one, or those of two others. Or the last ones of a chain, of which each link has an event
   and refers to the link before. Numbers are places in the table, plus 1. */
typedef struct some_events {
    place at;
    uint32_t left;
    uint32_t right;
    uint32_t used; /* the number of references, or the next free one */
#if RVAFT_FRONTS
    uint32_t count; /* of the links, or 0 */
#endif
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
typedef struct leaf {
    uint32_t node;
    uint32_t unit;
    uint32_t pattern;
    uint32_t guard;  /* 0: none */
    uint32_t after;  /* the place of the match that must be complete before; NONE for none */
    uint32_t names;  /* the first field in `names` that names its instance */
    uint32_t kind;   /* of the instance with its last events */
    uint32_t count;
    uint32_t ring;
    uint16_t timed; /* whether a window needs the time of the event */
    uint16_t settled; /* whether no event is of use once the leaf, or a node above, is complete */
#if !RVAFT_FRONTS
    uint32_t levels; /* 1, and the levels of the match at `after` */
    uint32_t room;   /* the place of the last events in `starts` */
#endif
} leaf;

typedef struct kind {
    uint32_t names;
    uint32_t slots;  /* the number of starts of matches, or of fronts */
    uint64_t within; /* without an event for longer, an instance is over */
#if RVAFT_BY
    uint32_t by; /* the name by which matches are repeated */
#endif
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

/* @events */
/* Whether a time is before the least time of later events by more than a duration, after some latenesses. */
RVAFT_UNUSED static int has_passed(int64_t latest, int64_t time, uint64_t within, uint64_t latenesses) {
    uint64_t since = (uint64_t)latest - (uint64_t)time, late = latenesses * lateness();
    return RVAFT_LATE >= 0 && latest > time && since > late && since - late > within;
}

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
#if RVAFT_FRONTS
    s->count = 0;
#endif
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

/* Add a place to those of a match, in the order of the log. */
static void note_place(found_match *f, const place *at) {
    uint32_t to = f->taken < RVAFT_DEPTH ? f->taken++ : 0;
    for (; to > 0 && f->events[to - 1].number > at->number; to--) {
        place moved = f->events[to - 1];
        f->events[to] = moved;
    }
    f->events[to] = *at;
}

/* Note the places of some events. */
static void note_match(rvaft_monitor *m, uint32_t number) {
    found_match *f = &m->match;
    uint32_t left = 1;
    f->taken = 0;
    f->agenda[0] = number;
    while (left > 0 && left <= RVAFT_DEPTH) {
        const some_events *s = events_at(m, f->agenda[--left]);
#if RVAFT_FRONTS
        if (s->count != 0) {
            uint32_t i, link = s->left;
            for (i = s->count; i > 0 && link != 0; i--) {
                s = events_at(m, link);
                note_place(f, &s->at);
                link = s->left;
            }
            continue;
        }
#endif
        if (s->left == 0) {
            note_place(f, &s->at);
        } else if (left < RVAFT_DEPTH) {
            f->agenda[left++] = s->right;
            f->agenda[left++] = s->left;
        }
    }
}

#endif

/* @matches */
/* Instances. */

#if RVAFT_NAMED

#if RVAFT_KEYED
#define CURRENT_KEY(m) ((m)->key)
static int is_void(const rvaft_monitor *m, const instance *r) {
    return m->keys.item[r->key < RVAFT_KEYS ? r->key : 0].era != r->era;
}
static int has_key(const rvaft_monitor *m, const instance *r) { return r->key == m->key && !is_void(m, r); }
/* What is known of the times of the log of an instance. */
static const key_state *log_of(const rvaft_monitor *m, const instance *r) {
    return &m->keys.item[r->key < RVAFT_KEYS ? r->key : 0];
}
#else
#define CURRENT_KEY(m) 0U
#define is_void(m, r) 0
#define has_key(m, r) 1
#define log_of(m, r) (m)
#endif

/* Whether no later event can be in a match with those of an instance. */
static int is_over(const rvaft_monitor *m, const instance *r) {
#if RVAFT_EXPIRIES
    if (log_of(m, r)->has_latest && has_passed(log_of(m, r)->latest, r->latest, kind_of(r)->within, 1)) {
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

/* The bucket of an instance. */
static uint32_t *home_of(instance_table *t, const instance *r) {
    uint32_t i;
#if RVAFT_KEYED
    uint64_t h = hash_of(r->kind, r->key);
#else
    uint64_t h = hash_of(r->kind, 0);
#endif
    for (i = 0; i < kind_of(r)->names; i++) {
        h = hash_with(h, &ROW(r->name, i));
    }
    return bucket_of(t, h);
}

static void link_instance(instance_table *t, uint32_t number) {
    instance *r = &ROW(t->item, number);
    uint32_t *home = home_of(t, r);
    r->next = *home;
    *home = number + 1;
}

#if RVAFT_KEYED
/* Mark the keys with an instance of which an event may still be in a match, by the greatest time of all keys. */
static void mark_keys(rvaft_monitor *m) {
    uint32_t i;
    for (i = 0; i < m->instances.count && i < RVAFT_INSTANCES; i++) {
        const instance *r = &m->instances.item[i];
        int live = r->kind != NONE && !is_void(m, r);
#if RVAFT_EXPIRIES
        live = live && !has_passed(m->keys.newest, r->latest, kind_of(r)->within, 2);
#endif
        if (live) {
            ROW(m->keys.live, r->key) = 1;
        }
    }
}
#endif

/* Make an instance free, which is in no bucket any more. */
static void free_instance(rvaft_monitor *m, uint32_t number) {
    instance_table *t = &m->instances;
    instance *r = &ROW(t->item, number);
    drop_kept(m, &r->kept);
    r->kind = NONE;
    r->next = t->spare;
    t->spare = number + 1;
    t->used--;
}

/* Remove the instances that are over. */
static void drop_instances(rvaft_monitor *m) {
    instance_table *t = &m->instances;
    uint32_t i;
    for (i = 0; i < t->count && i < RVAFT_INSTANCES; i++) {
        instance *r = &t->item[i];
        if (r->kind != NONE && is_over(m, r)) {
            free_instance(m, i);
        } else if (r->kind != NONE && log_of(m, r)->has_latest) {
            trim_kept(m, &r->kept, r->kind, log_of(m, r)->latest);
        }
    }
}

/* Remove the instances that are over, and adapt the number of buckets; again when there are twice as
   many, so that the work per event stays bounded. Keys are forgotten rather than that there is no room. */
static void sweep(rvaft_monitor *m) {
    instance_table *t = &m->instances;
    uint32_t i;
    drop_instances(m);
#if RVAFT_KEYED
    if ((t->used > RVAFT_INSTANCES - RVAFT_INSTANCES / 8 || has_little_room(m)) && forget_keys(m, RVAFT_KEYS)) {
        drop_instances(m);
    }
#endif
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
        if (at <= t->touched) {
            forget_kept(&r->kept);
        }
        t->touched = at > t->touched ? at : t->touched;
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
#if RVAFT_EXPIRIES
    r->latest = INT64_MIN;
#endif
    t->used++;
    link_instance(t, at - 1);
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
                drop_kept(m, &r->kept);
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

#if RVAFT_EXPIRIES
#define NOTE_TIME(r, e) (r)->latest = (e)->has_time && (e)->time > (r)->latest ? (e)->time : (r)->latest
#else
#define NOTE_TIME(r, e) (void)(r)
#endif

#if RVAFT_RINGED
/* What the instance with the last events of a leaf keeps, or NULL. */
static kept *counting(rvaft_monitor *m, const rvaft_event *e, kept *r, const leaf *l) {
    instance *own;
    if (l->kind == l->unit) {
        return r;
    }
    own = instance_of(m, e, l, l->kind, 1);
    if (own == NULL) {
        return NULL;
    }
    NOTE_TIME(own, e);
    return &own->kept;
}
#endif

/* @follow */
/* Whether a node, or one above it, is complete. */
static int is_settled(const kept *r, uint32_t number) {
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
        if (r == NULL || !is_kept(&r->kept, l->after)) {
            return NULL;
        }
    }
    if ((l->guard != 0 && !guard(&m->error, l->guard, e)) || m->error != 0) {
        return NULL;
    }
    return r == NULL ? instance_of(m, e, l, l->unit, 1) : r;
}

/* Take an event at a leaf; returns 1 if it detects. */
static int take_event(rvaft_monitor *m, const rvaft_event *e, const leaf *l) {
    instance *r = serving(m, e, l);
    if (r == NULL) {
        return 0;
    }
    NOTE_TIME(r, e);
    return !(l->settled && is_settled(&r->kept, l->node)) && take(m, e, &r->kept, l);
}

#if RVAFT_BY
/* Remove the instances with one name that have a value, and return whether others have names, too. */
static int remove_named(rvaft_monitor *m, const cell *value) {
    instance_table *t = &m->instances;
    uint32_t number;
    int several = 0;
    for (number = 0; number < sizeof kinds / sizeof kinds[0]; number++) {
        uint32_t *at = bucket_of(t, hash_with(hash_of(number, CURRENT_KEY(m)), value));
        if (kinds[number].names > 1) {
            several = 1;
            continue;
        }
        while (*at != 0 && *at <= RVAFT_INSTANCES) {
            const uint32_t found = *at - 1;
            instance *r = &t->item[found];
            if (r->kind == number && has_key(m, r) && same_cell(&r->name[0], value)) {
                *at = r->next;
                free_instance(m, found);
            } else {
                at = &r->next;
            }
        }
    }
    return several;
}

/* Remove the instances with a value of the variable by which matches are repeated. */
static void restart(rvaft_monitor *m, const cell *value) {
    instance_table *t = &m->instances;
    uint32_t i;
    if (value->tag == RVAFT_UNDEFINED || !remove_named(m, value)) {
        return;
    }
    for (i = 0; i < t->count && i < RVAFT_INSTANCES; i++) {
        instance *r = &t->item[i];
        if (r->kind != NONE && has_key(m, r) && same_cell(&ROW(r->name, kind_of(r)->by), value)) {
            uint32_t *at = home_of(t, r);
            while (*at != i + 1 && *at != 0 && *at <= RVAFT_INSTANCES) {
                at = &t->item[*at - 1].next;
            }
            *at = r->next;
            free_instance(m, i);
        }
    }
}
#endif

/* Take an event at all leaves, the last ones of sequences first, so that no event is used twice. */
/*@ assigns *m; */
static int scattered(rvaft_monitor *m, const rvaft_event *e, const uint8_t *matches) {
    uint32_t i;
#if RVAFT_BY
    uint8_t detected[RVAFT_LEAVES] = {0};
    int some = 0;
#endif
    for (i = 0; i < RVAFT_LEAVES; i++) {
        const leaf *l = &leaves[i];
        if (matches[l->pattern] && take_event(m, e, l)) {
#if RVAFT_BY
            detected[i] = 1;
            some = 1;
#else
            return 1;
#endif
        }
        if (m->error != 0) {
            return 0;
        }
    }
#if RVAFT_BY
    for (i = 0; some && i < RVAFT_LEAVES; i++) {
        if (detected[i]) {
            restart(m, cell_of(m, e, ROW(names, leaves[i].names + ROW(kinds, leaves[i].unit).by), 0));
        }
    }
    return some;
#else
    return 0;
#endif
}

/* Remove what no later event can complete. */
RVAFT_UNUSED static void tidy(rvaft_monitor *m) {
#if RVAFT_NAMED
    sweep(m);
#else
    uint32_t i;
    for (i = 0; m->has_latest && i < RVAFT_INSTANCES; i++) {
        trim_kept(m, &m->instances.item[i].kept, i, m->latest);
    }
#endif
    set_crowded(m);
}

/* The verdict after an event. */
/*@ requires \valid(m) && \valid_read(e) && \separated(m, e);
    assigns *m; */
static int follow(rvaft_monitor *m, const rvaft_event *e, int late) {
    uint8_t matches[RVAFT_PATTERNS];
    m->number++;
    if (late) {
        return RVAFT_UNKNOWN;
    }
    if (is_crowded(m)) {
        tidy(m);
    }
    match(matches, e);
    return scattered(m, e, matches) ? RVAFT_TRUE : RVAFT_UNKNOWN;
}

/* @begin */
static void begin(rvaft_monitor *m) {
    instance_table *t = &m->instances;
    uint32_t i;
#if RVAFT_NAMED
    for (i = 0; i <= t->mask && i < RVAFT_BUCKETS && t->mask != 0; i++) {
        t->head[i] = 0;
    }
    t->mask = FEW;
    t->count = 0;
    t->used = 0;
    t->spare = 0;
    t->sweep_at = RVAFT_INSTANCES < 2 * FEW ? RVAFT_INSTANCES : 2 * FEW;
    forget_kept(&t->item[RVAFT_INSTANCES].kept);
#else
    for (i = 0; i < RVAFT_INSTANCES; i++) {
        forget_kept(&t->item[i].kept);
    }
#endif
    begin_kept(m);
#if RVAFT_PLACES
    m->events.count = 0;
    m->events.spare = 0;
#endif
}

/* @bytes */
/* Append bytes while there is room. */
static void put_state(char *to, size_t size, size_t *used, const void *from, size_t more) {
    if (*used + more <= size) {
        memcpy(to + *used, from, more);
    }
    *used += more;
}

/* @state */
/* Append an instance; returns 0 if it has nothing. */
static int put_instance(const rvaft_monitor *m, const instance *r, uint32_t number, char *to, size_t size,
                        size_t *used) {
    (void)m;
    put_state(to, size, used, &number, sizeof number);
#if RVAFT_NAMED
    uint32_t k;
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
    return put_kept(m, &r->kept, number, to, size, used);
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
