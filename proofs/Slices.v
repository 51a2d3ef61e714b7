(** * Slices: texts whose predicates have variables

    LTLf and HOA have no variables.  A text of a tree with variables is read once for each partial
    assignment that events can give to them: a slice of a trace is the trace with such an assignment
    beside each event.  At an event a slice keeps its assignment, or extends it by the variables of one
    atom that this event makes true.  An atom is false while one of its variables is unbound, and a
    guard counts as true until all its variables are bound.

    A slice is thus a trace of events seen under assignments, and has the verdict of section 5 of
    [docs/semantics.md].  The text is true when some slice is, and false when all are. *)

Require Import List Bool Arith ZArith Lia.
Require Import RVAFT.Values RVAFT.Language RVAFT.Definition RVAFT.Search RVAFT.Conditions RVAFT.Scenarios.
Require Import RVAFT.Monitor RVAFT.Plain RVAFT.Acceptance.
Import ListNotations.

(** ** Partial assignments *)

Definition assignment := nat -> option value.

Definition unbound : assignment := fun _ => None.
Definition binds (b : assignment) (x : nat) : bool := match b x with Some _ => true | None => false end.
Definition values_of (b : assignment) (x : nat) : value := match b x with Some v => v | None => Null end.
Definition grows (b b' : assignment) : Prop := forall x v, b x = Some v -> b' x = Some v.

Lemma grows_refl : forall b, grows b b.
Proof. intros b x v H; exact H. Qed.

Lemma grows_trans : forall a b c, grows a b -> grows b c -> grows a c.
Proof. intros a b c H K x v Q. auto. Qed.

Lemma grows_binds : forall b b' x, grows b b' -> binds b x = true -> binds b' x = true /\
  values_of b' x = values_of b x.
Proof.
  intros b b' x G B. unfold binds, values_of in *. destruct (b x) as [v |] eqn:Q; [| discriminate].
  now rewrite (G x v Q).
Qed.

(** ** Atoms with variables *)

(** An event seen under an assignment. *)
Notation sliced := (event * assignment)%type.

(** An atom: the pattern of an event, the variable for the time of this event if the text names it, and
    guards. *)
Record atom := SlicedAtom { atom_pattern : pattern; atom_time : option nat; atom_guards : list guard }.

Definition atom_variables (q : atom) : list nat :=
  pattern_variables (atom_pattern q) ++ match atom_time q with Some x => [x] | None => [] end.

(** A time is an integer, and null when it is undefined. *)
Definition time_value (e : event) : value := match time_of e with Some z => integer z | None => Null end.

Definition passes (b : assignment) (g : guard) : bool :=
  negb (forallb (binds b) (variables g)) || holds (values_of b) no_time g.

Definition agrees (b : assignment) (bs : binding nat) : bool :=
  forallb (fun y => value_eqb (values_of b (fst y)) (snd y)) bs.

Definition observes (q : atom) (y : sliced) : bool :=
  let '(e, b) := y in
  negb (late e) && forallb (binds b) (atom_variables q) && existsb (agrees b) (bindings (atom_pattern q) (content
    e)) &&
  match atom_time q with Some x => value_eqb (values_of b x) (time_value e) | None => true end &&
  forallb (passes b) (atom_guards q).

Lemma agrees_iff : forall b bs, agrees b bs = true <-> respects (values_of b) bs.
Proof.
  intros b bs. unfold agrees, respects. rewrite forallb_forall. split.
  - intros H x v I. now apply (H (x, v)), value_eqb_iff in I.
  - intros H [x v] I. apply value_eqb_iff. now apply H.
Qed.

Lemma observes_iff : forall q e b, observes q (e, b) = true <->
  late e = false /\ (forall x, In x (atom_variables q) -> binds b x = true) /\
  fits_pattern (values_of b) (atom_pattern q) (content e) /\
  (forall x, atom_time q = Some x -> values_of b x = time_value e) /\
  (forall g, In g (atom_guards q) -> passes b g = true).
Proof.
  intros q e b. unfold observes. rewrite !andb_true_iff, negb_true_iff, !forallb_forall, existsb_exists, bindings_iff.
  assert (T : match atom_time q with Some x => value_eqb (values_of b x) (time_value e) | None => true end = true <->
    (forall x, atom_time q = Some x -> values_of b x = time_value e)).
  { destruct (atom_time q) as [x |]; [| split; [discriminate | auto]]. rewrite value_eqb_iff. split; [| auto].
    intros H y Q. injection Q as <-. exact H. }
  rewrite T. split.
  - intros ((((L & V) & (bs & I & A)) & Z) & G). apply agrees_iff in A. repeat split; eauto.
  - intros (L & V & (bs & I & A) & Z & G). apply agrees_iff in A. repeat split; eauto.
Qed.

(** ** The slices of a trace *)

(** The assignment after an event: the same one, or one more atom is true, whose variables are bound. *)
Inductive Binds (atoms : list atom) (e : event) (b b' : assignment) : Prop :=
| keeps : (forall x, b' x = b x) -> Binds atoms e b b'
| extends : forall q, In q atoms -> observes q (e, b') = true -> grows b b' ->
    (forall x, ~ In x (atom_variables q) -> b' x = b x) -> Binds atoms e b b'.

Definition latest (p : list sliced) : assignment := last (map snd p) unbound.

Inductive Slice (atoms : list atom) : list event -> list sliced -> Prop :=
| slice_start : Slice atoms [] []
| slice_event : forall u p e b, Slice atoms u p -> Binds atoms e (latest p) b ->
    Slice atoms (u ++ [e]) (p ++ [(e, b)]).

(** The verdict of a text over its slices; each slice has the verdict of section 5. *)
Definition SliceVerdict (atoms : list atom) (accepts : list sliced -> Prop) (u : list event) (v : verdict) : Prop :=
  let top := exists p, Slice atoms u p /\ TextVerdict accepts p Top in
  let bottom := forall p, Slice atoms u p -> TextVerdict accepts p Bottom in
  match v with Top => top | Bottom => bottom | Unknown => ~ top /\ ~ bottom end.

(** Assignments grow from each position to the later ones. *)
Definition Growing (p : list sliced) : Prop := forall i j y z, i <= j ->
  nth_error p i = Some y -> nth_error p j = Some z -> grows (snd y) (snd z).

Lemma latest_snoc : forall p y, latest (p ++ [y]) = snd y.
Proof. intros p y. unfold latest. rewrite map_app. apply last_last. Qed.

Lemma binds_grows : forall atoms e b b', Binds atoms e b b' -> grows b b'.
Proof. intros atoms e b b' [K | q _ _ G _]; auto. intros x v Q. now rewrite K. Qed.

Lemma slice_events : forall atoms u p, Slice atoms u p -> u = map fst p.
Proof.
  intros atoms u p S; induction S as [| u p e b S IH B]; auto. rewrite map_app. simpl. f_equal. exact IH.
Qed.

Lemma latest_grows : forall p i y, Growing p -> nth_error p i = Some y -> grows (snd y) (latest p).
Proof.
  intros p i y G N. destruct p as [| z p] using rev_ind; [destruct i; discriminate |]. rewrite latest_snoc.
  apply (G i (length p) y z); auto.
  - assert (i < length (p ++ [z])) by (apply nth_error_Some; congruence). rewrite app_length in H; simpl in H; lia.
  - apply nth_end.
Qed.

Lemma slice_growing : forall atoms u p, Slice atoms u p -> Growing p.
Proof.
  intros atoms u p S; induction S as [| u p e b S IH B]; intros i j y z L Y Z; [destruct i; discriminate |].
  destruct (lt_eq_lt_dec j (length p)) as [[J | J] | J].
  - rewrite nth_error_app1 in Y, Z by lia. eauto.
  - subst j. rewrite nth_end in Z. injection Z as <-. destruct (Nat.eq_dec i (length p)) as [-> | N].
    + rewrite nth_end in Y. injection Y as <-. apply grows_refl.
    + rewrite nth_error_app1 in Y by lia. eapply grows_trans; [eapply latest_grows; eauto |].
      now apply binds_grows in B.
  - assert (j < length (p ++ [(e, b)])) by (apply nth_error_Some; congruence).
    rewrite app_length in H; simpl in H; lia.
Qed.

Lemma growing_prefix : forall p q, Growing (p ++ q) -> Growing p.
Proof. intros p q G i j y z L Y Z. eapply G; eauto using nth_app_some. Qed.

(** A slice may keep its assignment. *)
Lemma slice_keeps : forall atoms u p v, Slice atoms u p -> exists q, Slice atoms (u ++ v) (p ++ q).
Proof.
  intros atoms u p v S; induction v as [| e v (q & IH)] using rev_ind; [exists []; now rewrite !app_nil_r |].
  exists (q ++ [(e, latest (p ++ q))]). rewrite !app_assoc. constructor; auto. now apply keeps.
Qed.

(** The trace with an assignment for each position. *)
Fixpoint under (b : nat -> assignment) (i : nat) (u : list event) : list sliced :=
  match u with [] => [] | e :: u => (e, b i) :: under b (S i) u end.

Lemma under_snoc : forall b u i e, under b i (u ++ [e]) = under b i u ++ [(e, b (i + length u))].
Proof.
  intros b; induction u as [| f u IH]; intros i e; simpl; [now rewrite Nat.add_0_r |].
  now rewrite IH, Nat.add_succ_r.
Qed.

Lemma nth_under : forall b u i j, nth_error (under b i u) j = option_map (fun e => (e, b (i + j))) (nth_error u j).
Proof.
  intros b; induction u as [| e u IH]; intros i [| j]; simpl; auto; [now rewrite Nat.add_0_r |].
  now rewrite IH, Nat.add_succ_r.
Qed.

Lemma under_events : forall b u i, map fst (under b i u) = u.
Proof. induction u as [| e u IH]; intros i; simpl; auto. now rewrite IH. Qed.

(** [b i] is the assignment before the event at position [i]. *)
Lemma slice_under : forall atoms b u, (forall x, b 0 x = None) ->
  (forall i e, nth_error u i = Some e -> Binds atoms e (b i) (b (S i))) ->
    Slice atoms u (under (fun i => b (S i)) 0 u).
Proof.
  intros atoms b u Z B.
  assert (L : forall u, latest (under (fun i => b (S i)) 0 u) = match u with [] => unbound | _ => b (length u) end).
  { intros v. destruct v as [| e v] using rev_ind; auto. rewrite under_snoc, latest_snoc. simpl.
    destruct (v ++ [e]) eqn:Q; [destruct v; discriminate |]. rewrite <- Q, app_length. simpl. f_equal. lia. }
  induction u as [| e u IH] using rev_ind; [constructor |]. rewrite under_snoc. constructor.
  - apply IH. intros i f N. apply B. now apply nth_app_some.
  - specialize (B (length u) e (nth_end u e)). rewrite L. destruct u as [| f u]; auto.
    destruct B as [K | q I O G K].
    + apply keeps. intros x. now rewrite K, Z.
    + apply extends with q; auto; [intros x v Q; discriminate |]. intros x N. now rewrite K, Z.
Qed.
