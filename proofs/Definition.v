(** * The meaning of a tree: sections 2 to 4 of [docs/semantics.md]

    Each definition stands below the clause that it states, quoted from that page with its number.
    The definitions are declarative: nothing here is computed.  [Monitor.v] proves that the
    extracted monitor gives the verdicts that are defined here. *)

Require Import List Bool Arith ZArith.
From RVAFT Require Import Values Language.
Import ListNotations.

(** ** Section 2: scenarios *)

(** The nodes that a scenario reaches, each with the children that it keeps. *)
Definition resolution := list (nat * list nat).

Inductive Sublist {A} : list A -> list A -> Prop :=
| sublist_nil : Sublist [] []
| sublist_take : forall x l m, Sublist l m -> Sublist (x :: l) (x :: m)
| sublist_skip : forall x l m, Sublist l m -> Sublist l (x :: m).

(* clause 2.1 *)
Definition Choice (d : node) (kept : list nat) : Prop :=
  match gate_of d with
  | Or => exists c, In c (children d) /\ kept = [c]
  | AtLeast k => k <= length kept /\ Sublist kept (children d)
  | Leaf | And | Sand | SandRl | Pand => kept = children d
  end.

Inductive Reached (r : resolution) (from : nat) : nat -> Prop :=
| reached_itself : Reached r from from
| reached_child : forall n kept c, Reached r from n -> In (n, kept) r -> In c kept -> Reached r from c.

Fixpoint Increasing (least : nat) (l : list nat) : Prop :=
  match l with [] => True | x :: l => least <= x /\ Increasing (S x) l end.

Definition Resolution (t : tree) (r : resolution) : Prop :=
  Increasing 0 (map fst r) /\
  (forall n kept, In (n, kept) r -> Choice (node_at t n) kept) /\
  (forall n, In n (map fst r) <-> Reached r 0 n /\ n < length (nodes t)).

(* clause 2.2 *)
Definition Occurs (t : tree) (r : resolution) (o : occurrence) : Prop :=
  In (fst o) (map fst r) /\ on (node_at t (fst o)) <> None /\ snd o < times (node_at t (fst o)).

(** The part of a node: the occurrences of the node and its descendants in the scenario. *)
Definition InPart (t : tree) (r : resolution) (n : nat) (o : occurrence) : Prop :=
  Occurs t r o /\ Reached r n (fst o).

(** [c] stands before [d] in a list. *)
Inductive Earlier {A} : list A -> A -> A -> Prop :=
| earlier_here : forall c d l, In d l -> Earlier (c :: l) c d
| earlier_there : forall x c d l, Earlier l c d -> Earlier (x :: l) c d.

(** The precedence of a scenario.  [last n c] is the occurrence with which the part of child [c] of
    the gate [n] ends, where [n] is a [pand]. *)
Inductive Precedes (t : tree) (r : resolution) (last : nat -> nat -> occurrence) : occurrence -> occurrence -> Prop :=
| counted : (* clause 2.2 *)
    forall n i j, i < j -> Precedes t r last (n, i) (n, j)
| cause_first : (* clause 2.3 *)
    forall n m i j, top_down t = true -> n <> m -> Reached r n m -> Precedes t r last (n, i) (m, j)
| cause_last : (* clause 2.3 *)
    forall n m i j, top_down t = false -> n <> m -> Reached r n m -> Precedes t r last (m, j) (n, i)
| in_sequence : (* clause 2.4 *)
    forall n kept c d p o, In (n, kept) r -> gate_of (node_at t n) = Sand -> Earlier kept c d ->
    InPart t r c p -> InPart t r d o -> Precedes t r last p o
| in_reverse : (* clause 2.4 *)
    forall n kept c d p o, In (n, kept) r -> gate_of (node_at t n) = SandRl -> Earlier kept c d ->
    InPart t r d p -> InPart t r c o -> Precedes t r last p o
| at_the_end : (* clause 2.5 *)
    forall n kept c o, In (n, kept) r -> gate_of (node_at t n) = Pand -> In c kept ->
    InPart t r c o -> o <> last n c -> Precedes t r last o (last n c)
| ends_in_order : (* clause 2.5 *)
    forall n kept c d p o, In (n, kept) r -> gate_of (node_at t n) = Pand -> Earlier kept c d ->
    InPart t r c p -> InPart t r d o -> Precedes t r last (last n c) (last n d).

(** Each part with an occurrence below a [pand] ends with one of its occurrences. *)
Definition Lasts (t : tree) (r : resolution) (last : nat -> nat -> occurrence) : Prop :=
  forall n kept c o, In (n, kept) r -> gate_of (node_at t n) = Pand -> In c kept -> InPart t r c o ->
  InPart t r c (last n c).

(** *** The conditions of a scenario, on a finite map from occurrences to events *)

Definition assigned E := list (occurrence * E).
Definition domain {E} (m : assigned E) : list occurrence := map fst m.

(** The event fits the occurrence.  No occurrence uses a late event (clause 3.3). *)
Definition Fits (t : tree) (a : nat -> value) (o : occurrence) (e : event) : Prop :=
  late e = false /\ exists p, on (node_at t (fst o)) = Some p /\ fits_pattern a p (content e).

(** The time [z] of a point (section 1.2): [start] and [end] are the least and the greatest time of a
    part, all of whose events have times. *)
Definition Bounds (t : tree) (r : resolution) (m : assigned event) (le : Z -> Z -> Prop) (n : nat) (z : Z) : Prop :=
  (exists o e, InPart t r n o /\ In (o, e) m /\ time_of e = Some z) /\
  (forall o, InPart t r n o -> exists e z', In (o, e) m /\ time_of e = Some z' /\ le z z').

Definition IsTime (t : tree) (r : resolution) (m : assigned event) (p : point) (z : Z) : Prop :=
  match p with
  | At n => exists e, In ((n, 0), e) m /\ time_of e = Some z
  | Start n => Bounds t r m Z.le n z
  | End n => Bounds t r m Z.ge n z
  end.

(** A guard is known when its variables are bound and the events of its time points are there. *)
Definition Known (t : tree) (r : resolution) (m : assigned event) (g : guard) : Prop :=
  (forall x, In x (variables g) ->
     exists o p, In o (domain m) /\ on (node_at t (fst o)) = Some p /\ In x (pattern_variables p)) /\
  (forall p, In p (points g) ->
     match p with
     | At n => In (n, 0) (domain m)
     | Start n | End n => forall o, InPart t r n o -> In o (domain m)
     end).

(** Every event fits its occurrence under one assignment of the variables, and every known guard
    holds under it. *)
Definition Consistent (t : tree) (r : resolution) (m : assigned event) : Prop :=
  exists a time,
    (forall o e, In (o, e) m -> Fits t a o e) /\
    (forall p z, time p = Some z <-> IsTime t r m p z) /\
    (forall n g, In n (map fst r) -> In g (conditions t n) -> Known t r m g -> holds a time g = true).

(* clause 2.6 *)
Definition Feasible (t : tree) (r : resolution) (last : nat -> nat -> occurrence) : Prop :=
  (exists rank : occurrence -> nat,
     forall p o, Occurs t r p -> Occurs t r o -> Precedes t r last p o -> rank p < rank o) /\
  (forall n g, In n (map fst r) -> In g (conditions t n) -> variables g = [] -> points g = [] ->
     holds (fun _ => Null) (fun _ => None) g = true).

(** What sections 3 and 4 need of a scenario. *)
Record scenario E := Scenario {
  occurrences : list occurrence;
  before : occurrence -> occurrence -> Prop;
  consistent : assigned E -> Prop }.
Arguments occurrences {E}. Arguments before {E}. Arguments consistent {E}.

(* clause 2.7 *)
Definition BranchChoice (d : node) (kept : list nat) : Prop :=
  match gate_of d with
  | Or => exists c, In c (children d) /\ kept = [c]
  | Leaf | And | Sand | SandRl | Pand | AtLeast _ => kept = children d
  end.

Definition Branch (t : tree) (b : resolution) : Prop :=
  Increasing 0 (map fst b) /\
  (forall n kept, In (n, kept) b -> BranchChoice (node_at t n) kept) /\
  (forall n, In n (map fst b) <-> Reached b 0 n /\ n < length (nodes t)).

(** A scenario is one of a branch when it makes the same choices at each [or] that it reaches. *)
Definition InBranch (t : tree) (b r : resolution) : Prop :=
  forall n kept, In (n, kept) r -> gate_of (node_at t n) = Or -> In (n, kept) b.

(** What a monitor watches: the whole tree, one branch, or the branches that have a node of a kind. *)
Inductive selection := Everything | OneBranch (b : resolution) | OfKind (k : kind).

Definition Selected (t : tree) (s : selection) (r : resolution) : Prop :=
  match s with
  | Everything => True
  | OneBranch b => InBranch t b r
  | OfKind k => exists b, Branch t b /\ InBranch t b r /\
                exists n, In n (map fst b) /\ kind_of (node_at t n) = Some k
  end.

(** The feasible scenarios of a tree; under [pand] one for each way in which its parts end. *)
Definition IsScenario (t : tree) (s : selection) (c : scenario event) : Prop :=
  exists r last, Resolution t r /\ Selected t s r /\ Lasts t r last /\ Feasible t r last /\
    (forall o, In o (occurrences c) <-> Occurs t r o) /\
    (forall p o, Occurs t r p -> Occurs t r o -> (before c p o <-> Precedes t r last p o)) /\
    (forall m, NoDup (domain m) -> (consistent c m <-> Consistent t r m)).

(** ** Section 3: detection *)

Inductive semantics := Strict | Projected | Consecutive | Scattered.

Section Detection.
Context {E : Type}.
Variable Relevant : E -> Prop.

(* clause 3.1 *)
(** [m] assigns events to some occurrences, and [position] says where these events are in the trace. *)
Record Partial (c : scenario E) (trace : list E) (position : occurrence -> nat) (m : assigned E) : Prop := {
  once : NoDup (domain m);
  of_scenario : incl (domain m) (occurrences c);
  at_positions : forall o e, In (o, e) m -> nth_error trace (position o) = Some e;
  no_position_twice : forall o p, In o (domain m) -> In p (domain m) -> position o = position p -> o = p;
  downward_closed : forall o p, In o (domain m) -> In p (occurrences c) -> before c p o -> In p (domain m);
  precedence_kept : forall o p, In o (domain m) -> In p (domain m) -> before c p o -> position p < position o;
  conditions_hold : consistent c m }.

Definition complete (c : scenario E) (m : assigned E) : Prop := incl (occurrences c) (domain m).
Definition Used (position : occurrence -> nat) (m : assigned E) (i : nat) : Prop :=
  exists o, In o (domain m) /\ position o = i.
Definition RelevantAt (trace : list E) (i : nat) : Prop :=
  exists e, nth_error trace i = Some e /\ Relevant e.

(* clause 3.2 *)
Definition match_positions (s : semantics) (trace : list E) (used : nat -> Prop) : Prop :=
  match s with
  | Strict => exists k, forall i, used i <-> i < k
  | Projected => exists k, forall i, used i <-> i < k /\ RelevantAt trace i
  | Consecutive => exists j k, forall i, used i <-> j <= i < k /\ RelevantAt trace i
  | Scattered => True
  end.

Definition Match (s : semantics) (c : scenario E) (trace : list E) : Prop :=
  exists position m, Partial c trace position m /\ complete c m /\ match_positions s trace (Used position m).

(** ** Section 4: verdicts *)

Variable Scenarios : scenario E -> Prop.

(* clause 4.1 *)
Definition Detected (s : semantics) (trace : list E) : Prop :=
  exists prefix rest c, trace = prefix ++ rest /\ Scenarios c /\ Match s c prefix.

(* clause 4.2 *)
Definition partial_positions (s : semantics) (trace : list E) (used : nat -> Prop) : Prop :=
  match s with
  | Strict => forall i, used i <-> i < length trace
  | Projected => forall i, used i <-> RelevantAt trace i
  | Consecutive => exists j, forall i, used i <-> j <= i /\ RelevantAt trace i
  | Scattered => True
  end.

Definition PartialMatch (s : semantics) (c : scenario E) (trace : list E) : Prop :=
  exists position m, Partial c trace position m /\ ~ complete c m /\ partial_positions s trace (Used position m).

Definition Left (s : semantics) (trace : list E) : Prop := exists c, Scenarios c /\ PartialMatch s c trace.

Inductive verdict := Top | Bottom | Unknown.

(* clauses 4.1, 4.2, 4.3 *)
Definition Verdict (s : semantics) (trace : list E) (v : verdict) : Prop :=
  match v with
  | Top => Detected s trace
  | Bottom => ~ Detected s trace /\ ~ Left s trace
  | Unknown => ~ Detected s trace /\ Left s trace
  end.

(* clause 4.5 *)
(** The events since the last detection, if monitoring starts afresh after each. *)
Inductive Since (s : semantics) : list E -> list E -> Prop :=
| since_start : Since s [] []
| since_before : forall trace recent e,
    Since s trace recent -> ~ Detected s recent -> Since s (trace ++ [e]) (recent ++ [e])
| since_detection : forall trace recent e,
    Since s trace recent -> Detected s recent -> Since s (trace ++ [e]) [e].

Definition RepeatedVerdict (s : semantics) (trace : list E) (v : verdict) : Prop :=
  exists recent, Since s trace recent /\ Verdict s recent v.
End Detection.

(** ** The verdict of a tree on a log *)

(** A log is a list of values with their times.  [lateness] makes a trace of it (section 1.1): an
    event is late when its time is more than [D] before the greatest time of the events before it. *)
Definition LateAt (d : Z) (log : list (value * option Z)) (i : nat) : Prop :=
  exists v z j w z', nth_error log i = Some (v, Some z) /\ j < i /\ nth_error log j = Some (w, Some z') /\
    (z + d < z')%Z.

Definition TraceOf (t : tree) (log : list (value * option Z)) (trace : list event) : Prop :=
  length trace = length log /\
  forall i e, nth_error trace i = Some e ->
    nth_error log i = Some (content e, time_of e) /\
    (late e = true <-> exists d, lateness t = Some d /\ LateAt d log i).

(* clause 3.4 *)
Definition whole (t : tree) : resolution := combine (seq 0 (length (nodes t))) (map children (nodes t)).

Definition Ignored (t : tree) (e : event) : Prop :=
  exists p g a, In (p, g) (ignores t) /\ fits_pattern a p (content e) /\
    match g with Some g => holds a (fun _ => None) g = true | None => True end.

Definition RelevantEvent (t : tree) (e : event) : Prop :=
  late e = false /\ ~ Ignored t e /\
  exists n p a, Reached (whole t) 0 n /\ on (node_at t n) = Some p /\ fits_pattern a p (content e) /\
    match when (node_at t n) with
    | Some g => points g = [] -> incl (variables g) (pattern_variables p) -> holds a (fun _ => None) g = true
    | None => True
    end.

(* clause 3.5: the scenarios are those of the selection, and the relevant events those of the whole tree *)
Definition VerdictOfTree (t : tree) (w : selection) (s : semantics) (trace : list event) (v : verdict) : Prop :=
  Verdict (RelevantEvent t) (IsScenario t w) s trace v.

Definition RepeatedVerdictOfTree (t : tree) (w : selection) (s : semantics) (trace : list event) (v : verdict) : Prop :=
  RepeatedVerdict (RelevantEvent t) (IsScenario t w) s trace v.
