(** * The language: patterns, guards, time points, and trees

    Section 1 of [docs/semantics.md], as far as sections 2 to 4 need it.  Nodes and variables are
    numbers; the root is node 0, and children have greater numbers than their parents. *)

Require Import List Bool Arith ZArith Lia.
From RVAFT Require Import Values.
Import ListNotations.

(** ** Event patterns *)

(** A rigid variable has one value in the whole tree.  A local variable belongs to one event. *)
Inductive name := Rigid (x : nat) | Local (x : nat).

Inductive pattern :=
| Exactly (v : value)
| Named (x : name)
| Anything
| ObjectWith (fields : list (text * pattern))
| ListOf (items : list pattern)
| SomeItem (item : pattern).

Fixpoint field (name : text) (fields : list (text * value)) : option value :=
  match fields with
  | [] => None
  | (other, v) :: fields => if text_eqb name other then Some v else field name fields
  end.

(** A value matches a pattern under an assignment of the variables. *)
Fixpoint matches (b : name -> value) (p : pattern) (v : value) : Prop :=
  match p with
  | Exactly w => v = w
  | Named x => b x = v
  | Anything => True
  | ObjectWith fields => exists object, v = Object object /\
      (fix all fields := match fields with
         | [] => True
         | (f, p) :: fields => (exists w, field f object = Some w /\ matches b p w) /\ all fields
         end) fields
  | ListOf items => exists list, v = List list /\
      (fix all items list := match items, list with
         | [], [] => True
         | p :: items, w :: list => matches b p w /\ all items list
         | _, _ => False
         end) items list
  | SomeItem p => exists list, v = List list /\ exists w, In w list /\ matches b p w
  end.

(** A value fits a pattern under an assignment of the rigid variables: for some local ones. *)
Definition fits_pattern (a : nat -> value) (p : pattern) (v : value) : Prop :=
  exists b, (forall x, b (Rigid x) = a x) /\ matches b p v.

(** The rigid variables of a pattern. *)
Fixpoint pattern_variables (p : pattern) : list nat :=
  match p with
  | Exactly _ | Anything | Named (Local _) => []
  | Named (Rigid x) => [x]
  | ObjectWith fields => flat_map (fun f => pattern_variables (snd f)) fields
  | ListOf items => flat_map pattern_variables items
  | SomeItem p => pattern_variables p
  end.

(** ** Guards *)

(** [at(n)], [start(n)] and [end(n)]. *)
Inductive point := At (n : nat) | Start (n : nat) | End (n : nat).

Inductive guard :=
| Constant (v : value)
| ValueOf (x : nat)
| TimeOf (p : point)
| Apply (o : operator) (operands : list guard)
| AndThen (a b : guard)
| OrElse (a b : guard).

Fixpoint all_defined {A} (l : list (option A)) : option (list A) :=
  match l with
  | [] => Some []
  | None :: _ => None
  | Some a :: l => option_map (cons a) (all_defined l)
  end.

(** The value of a guard; [None] is undefined.  [and] and [or] do not look at the right side when
    the left side decides. *)
Fixpoint eval (a : nat -> value) (time : point -> option Z) (g : guard) : option value :=
  match g with
  | Constant v => Some v
  | ValueOf x => Some (a x)
  | TimeOf p => option_map integer (time p)
  | Apply o operands =>
    match all_defined (map (eval a time) operands) with Some l => apply o l | None => None end
  | AndThen l r =>
    match eval a time l with
    | Some (Bool false) => Some (Bool false)
    | Some (Bool true) => match eval a time r with Some (Bool b) => Some (Bool b) | _ => None end
    | _ => None
    end
  | OrElse l r =>
    match eval a time l with
    | Some (Bool true) => Some (Bool true)
    | Some (Bool false) => match eval a time r with Some (Bool b) => Some (Bool b) | _ => None end
    | _ => None
    end
  end.

(** A guard holds when its value is [true]; undefined does not hold. *)
Definition holds a time g : bool := match eval a time g with Some (Bool b) => b | _ => false end.

Fixpoint variables (g : guard) : list nat :=
  match g with
  | Constant _ | TimeOf _ => []
  | ValueOf x => [x]
  | Apply _ l => flat_map variables l
  | AndThen l r | OrElse l r => variables l ++ variables r
  end.

Fixpoint points (g : guard) : list point :=
  match g with
  | Constant _ | ValueOf _ => []
  | TimeOf p => [p]
  | Apply _ l => flat_map points l
  | AndThen l r | OrElse l r => points l ++ points r
  end.

(** ** Events and their times *)

(** An event of a trace: a JSON value, its time in nanoseconds if it is defined, and whether it is
    late (section 1.1). *)
Record event := Event { content : value; time_of : option Z; late : bool }.

(** An occurrence is one of the events that a node observes: the node and a number below its
    [times]. *)
Definition occurrence := (nat * nat)%type.

(** ** Trees *)

Inductive gate := Leaf | Or | And | Sand | SandRl | Pand | AtLeast (k : nat).

Inductive kind := Fault | Attack.

(** [without CALL when GUARD]: an event that may not be there, during, [for D after], or [for D] before
    the part of its node (section 1.5). *)
Inductive side := During | After (d : Z) | Before (d : option Z).

Record absence := Absence { absent : pattern; absent_when : option guard; side_of : side }.

Record node := Node {
  gate_of : gate;
  children : list nat;
  on : option pattern;
  times : nat;
  when : option guard;
  within : option Z;
  kind_of : option kind;
  distinct_values : list nat;
  each_values : list nat;
  without : list absence }.

Record tree := Tree {
  nodes : list node;
  top_down : bool;
  ignores : list (pattern * option guard);
  lateness : option Z }.

Definition nowhere : node := Node Leaf [] None 1 None None None [] [] [].
Definition node_at (t : tree) (n : nat) : node := nth n (nodes t) nowhere.

(** The variables that each event of a node has for itself (clause 2.9). *)
Definition own_values (d : node) : list nat := distinct_values d ++ each_values d.
Definition is_own (t : tree) (o : occurrence) (x : nat) : bool :=
  existsb (Nat.eqb x) (own_values (node_at t (fst o))).

(** For pairs (X, X'), (Y, Y'), ... of values: [X != X' or Y != Y' or ...]. *)
Definition differ (pairs : list (guard * guard)) : guard :=
  fold_right (fun one rest => OrElse (Apply Differs [fst one; snd one]) rest) (Constant (Bool false)) pairs.

(** [within D] at a node is the guard [end(n) - start(n) <= D]. *)
Definition window (n : nat) (d : Z) : guard :=
  Apply LessOrEqual [Apply Subtract [TimeOf (End n); TimeOf (Start n)]; Constant (integer d)].

Definition conditions (t : tree) (n : nat) : list guard :=
  match when (node_at t n) with Some g => [g] | None => [] end ++
  match within (node_at t n) with Some d => [window n d] | None => [] end.

(** Whether a variable occurs in the [on] of some node, where its value is not one of the event alone. *)
Definition shared (t : tree) (x : nat) : bool :=
  existsb (fun n => match on (node_at t n) with
                    | Some p => existsb (Nat.eqb x) (pattern_variables p) && negb (is_own t (n, 0) x)
                    | None => false
                    end) (seq 0 (length (nodes t))).

(** The variables of an absent event. *)
Definition absence_variables (c : absence) : list nat :=
  pattern_variables (absent c) ++ match absent_when c with Some g => variables g | None => [] end.

(** The root is node 0, children have greater numbers, the variables of an [ignore] are its own, and those
    of a [without] are its own or occur in the tree. *)
Definition well_formed (t : tree) : bool :=
  Nat.ltb 0 (length (nodes t)) &&
  forallb (fun entry => forallb (fun c => Nat.ltb (fst entry) c && Nat.ltb c (length (nodes t))) (children (snd entry)))
          (combine (seq 0 (length (nodes t))) (nodes t)) &&
  forallb (fun i => match snd i with
                    | Some g => forallb (fun x => existsb (Nat.eqb x) (pattern_variables (fst i))) (variables g)
                    | None => true
                    end) (ignores t) &&
  forallb (fun d => forallb (fun c =>
      forallb (fun x => existsb (Nat.eqb x) (pattern_variables (absent c)) || shared t x) (absence_variables c))
    (without d)) (nodes t).
