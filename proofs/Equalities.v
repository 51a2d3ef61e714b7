(** * Guards as patterns: a normal form by equalities

    A text may write [X != "a"] as "no event of this pattern with "a" in the place of X", and [X in (1, 2)] as
    one of two patterns.  So a guard has its value from equalities of a variable with a literal or another
    variable, and an equality is a pattern in which the variable is replaced. *)

Require Import List Bool Arith ZArith Lia.
Require Import RVAFT.Values RVAFT.Language RVAFT.Definition RVAFT.Search RVAFT.Conditions RVAFT.Scenarios.
Require Import RVAFT.Monitor RVAFT.Plain RVAFT.Letters RVAFT.PlainTree RVAFT.Relevance RVAFT.Determined.
Import ListNotations.

(** ** An equality as a pattern *)

(** What a variable is compared with: a literal, or another variable. *)
Inductive operand := Literal (v : value) | Another (y : nat).

Definition operand_value (a : nat -> value) (o : operand) : value :=
  match o with Literal v => v | Another y => a y end.
Definition operand_pattern (o : operand) : pattern :=
  match o with Literal v => Exactly v | Another y => Named (Rigid y) end.

(** The pattern with the operand in the place of the variable, and without other variables. *)
Fixpoint focus (x : nat) (o : operand) (p : pattern) : pattern :=
  match p with
  | Exactly v => Exactly v
  | Named (Rigid y) => if Nat.eqb x y then operand_pattern o else Anything
  | Named (Language.Local _) | Anything => Anything
  | ObjectWith fields => ObjectWith (map (fun f => (fst f, focus x o (snd f))) fields)
  | ListOf items => ListOf (map (focus x o) items)
  | SomeItem p => SomeItem (focus x o p)
  end.

Lemma focus_matches : forall x o b c p v, matches b p v ->
  b (Rigid x) = operand_value (fun y => c (Rigid y)) o -> matches c (focus x o p) v.
Proof.
  intros x o b c; induction p as [w | y | | fields IH | items IH | p IH] using pattern_induction; intros v M Q; auto.
  - destruct y as [y | y]; [| exact I]. simpl. destruct (Nat.eqb_spec x y); [| exact I]. subst y.
    simpl in M. destruct o; simpl in *; congruence.
  - destruct M as (object & -> & M). exists object; split; auto.
    induction IH as [| [f p] fields H _ IHF]; auto. destruct M as [(w & F & M) M']. split; [| exact (IHF M')].
    exists w; split; [exact F | exact (H w M Q)].
  - destruct M as (l & -> & M). exists l; split; auto. revert l M.
    induction IH as [| p items H _ IHI]; intros [| w l] M; simpl in M; auto. destruct M as [M M'].
    split; [exact (H w M Q) | exact (IHI l M')].
  - destruct M as (l & -> & w & J & M). exists l; split; auto. exists w; auto.
Qed.

Lemma focus_value : forall x o c p v l, path x p = Some l -> matches c (focus x o p) v ->
  value_along l v = Some (operand_value (fun y => c (Rigid y)) o).
Proof.
  intros x o c; induction p as [w | y | | fields IH | items IH | p IH] using pattern_induction; intros v l P M;
    try discriminate.
  - destruct y as [y | y]; [| discriminate]. simpl in P, M. destruct (Nat.eqb_spec x y); [| discriminate].
    injection P as <-. destruct o; simpl in *; congruence.
  - destruct M as (object & -> & M). cbn [path] in P. revert l P.
    induction IH as [| [f p] fields H _ IHF]; intros l P; [discriminate |]. destruct M as [(w & F & M) M'].
    destruct (path x p) as [m |] eqn:Q; [| now apply IHF].
    injection P as <-. simpl. simpl in F. rewrite F. now apply H.
Qed.

(** Where the variable has a place, an event of the pattern fits the other one when both are equal. *)
Lemma focus_fits : forall x o p l a a' v, path x p = Some l -> fits_pattern a p v ->
  (fits_pattern a' (focus x o p) v <-> a x = operand_value a' o).
Proof.
  intros x o p l a a' v P (b & A & M). split.
  - intros (c & A' & N). apply (path_value x b p v l P) in M. apply (focus_value x o c p v l P) in N.
    rewrite <- A. destruct o; simpl in *; rewrite <- ?A'; congruence.
  - intros Q. set (c := fun y => match y with Rigid y => a' y | Language.Local _ => Null end).
    exists c. split; auto. apply focus_matches with b; auto. rewrite A, Q. now destruct o.
Qed.

Lemma focus_variables : forall x o p z, In z (pattern_variables (focus x o p)) -> o = Another z.
Proof.
  intros x o; induction p as [w | y | | fields IH | items IH | p IH] using pattern_induction; intros z Z; simpl in Z;
    try destruct Z.
  - destruct y as [y | y]; [| destruct Z]. simpl in Z. destruct (Nat.eqb x y); [| destruct Z].
    destruct o; [destruct Z |]. destruct Z as [-> | []]; auto.
  - apply in_flat_map in Z as (f & I & Z). apply in_map_iff in I as (g & <- & I). rewrite Forall_forall in IH.
    now apply (IH g I).
  - apply in_flat_map in Z as (q & I & Z). apply in_map_iff in I as (p & <- & I). rewrite Forall_forall in IH.
    now apply (IH p I).
  - now apply IH.
Qed.

(** ** The value of a guard from equalities *)

(** The equalities on which a guard depends. *)
Fixpoint equalities (g : guard) : list (nat * operand) :=
  match g with
  | Apply (Equals | Differs) [ValueOf x; Constant v] | Apply (Equals | Differs) [Constant v; ValueOf x] =>
    [(x, Literal v)]
  | Apply (Equals | Differs) [ValueOf x; ValueOf y] => [(x, Another y); (y, Another x)]
  | Apply (OneOf listed) [ValueOf x] => map (fun v => (x, Literal v)) listed
  | Apply Not [g] => equalities g
  | AndThen a b | OrElse a b => equalities a ++ equalities b
  | _ => []
  end.

Section Decide.
(** Whether a variable equals an operand, if this is known. *)
Variable equal : nat -> operand -> option bool.

Definition equal_values (g h : guard) : option bool :=
  match g, h with
  | ValueOf x, Constant v | Constant v, ValueOf x => equal x (Literal v)
  | ValueOf x, ValueOf y => match equal x (Another y) with Some b => Some b | None => equal y (Another x) end
  | _, _ => None
  end.

Definition some_equal (x : nat) (listed : list value) : option bool :=
  let found := map (fun v => equal x (Literal v)) listed in
  if forallb (fun f => match f with Some _ => true | None => false end) found
  then Some (existsb (fun f => match f with Some b => b | None => false end) found) else None.

Fixpoint decide (g : guard) : option bool :=
  match g with
  | Apply Equals [a; b] => equal_values a b
  | Apply Differs [a; b] => option_map negb (equal_values a b)
  | Apply (OneOf (v :: listed)) [ValueOf x] => some_equal x (v :: listed)
  | Apply Not [g] => option_map negb (decide g)
  | AndThen a b => match decide a with Some true => decide b | found => found end
  | OrElse a b => match decide a with Some false => decide b | found => found end
  | _ => None
  end.

Variable a : nat -> value.
Hypothesis equal_sound : forall x o b, equal x o = Some b ->
  defined (a x) = true /\ defined (operand_value a o) = true /\ b = value_eqb (a x) (operand_value a o).

Lemma value_eqb_sym : forall v w, value_eqb v w = value_eqb w v.
Proof. intros v w. apply eq_true_iff_eq. rewrite !value_eqb_iff. split; congruence. Qed.

Lemma equal_values_sound : forall g h b, equal_values g h = Some b -> exists v w,
  eval a no_time g = Some v /\ eval a no_time h = Some w /\ defined v = true /\ defined w = true /\ b = value_eqb v w.
Proof.
  intros g h b E.
  destruct g as [v | x | | | |]; try discriminate; destruct h as [w | y | | | |]; try discriminate; simpl in E.
  - apply equal_sound in E as (D & D' & ->). simpl in *. exists v, (a y). rewrite value_eqb_sym. auto 6.
  - apply equal_sound in E as (D & D' & ->). simpl in *. exists (a x), w. auto 6.
  - exists (a x), (a y). destruct (equal x (Another y)) eqn:X.
    + injection E as ->. apply equal_sound in X as (D & D' & ->). auto 6.
    + apply equal_sound in E as (D & D' & ->). rewrite value_eqb_sym. auto 6.
Qed.

Lemma some_equal_sound : forall x v l b, In v l -> some_equal x l = Some b ->
  defined (a x) = true /\ b = existsb (value_eqb (a x)) l.
Proof.
  intros x v l b J E. unfold some_equal in E. rewrite forallb_map, existsb_map in E.
  destruct (forallb _ l) eqn:F; [| discriminate]. injection E as <-. rewrite forallb_forall in F. split.
  - specialize (F v J). cbv beta in F. destruct (equal x (Literal v)) eqn:E; [| discriminate].
    now apply equal_sound in E.
  - apply Automaton.existsb_ext_in. intros w I. specialize (F w I). cbv beta in F.
    destruct (equal x (Literal w)) eqn:E; [| discriminate]. apply equal_sound in E as (_ & _ & ->). reflexivity.
Qed.

(** A guard that is decided has this value. *)
Theorem decide_sound : forall g b, decide g = Some b -> eval a no_time g = Some (Bool b).
Proof.
  induction g as [v | x | p | o l IH | g h IHg IHh | g h IHg IHh] using guard_induction; intros b D; try discriminate.
  - destruct o; try (destruct l as [| g [| h [| k l]]]; discriminate).
    + destruct l as [| g [| h [| k l]]]; try discriminate. cbn [decide] in D.
      apply equal_values_sound in D as (v & w & V & W & DV & DW & ->). simpl. rewrite V, W. unfold apply. simpl.
      now rewrite DV, DW.
    + destruct l as [| g [| h [| k l]]]; try discriminate. cbn [decide] in D.
      destruct (equal_values g h) eqn:E; [| discriminate]. injection D as <-.
      apply equal_values_sound in E as (v & w & V & W & DV & DW & ->). simpl. rewrite V, W. unfold apply. simpl.
      now rewrite DV, DW.
    + destruct l as [| g [| h l]]; try discriminate. cbn [decide] in D.
      destruct (decide g) eqn:E; [| discriminate]. injection D as <-. inversion IH; subst.
      match goal with H : forall b, decide g = Some b -> _ |- _ => apply H in E end. simpl. now rewrite E.
    + destruct listed as [| v listed]; [destruct l as [| [] [|]]; discriminate |].
      destruct l as [| [| x | | | |] [| h l]]; try discriminate. cbn [decide] in D.
      apply (some_equal_sound x v) in D as [D ->]; [| simpl; auto]. simpl. unfold apply. simpl. now rewrite D.
  - cbn [decide] in D. destruct (decide g) as [[] |] eqn:E; try discriminate.
    + simpl. rewrite (IHg true eq_refl), (IHh b D). reflexivity.
    + injection D as <-. simpl. now rewrite (IHg false eq_refl).
  - cbn [decide] in D. destruct (decide g) as [[] |] eqn:E; try discriminate.
    + injection D as <-. simpl. now rewrite (IHg true eq_refl).
    + simpl. rewrite (IHg false eq_refl), (IHh b D). reflexivity.
Qed.
End Decide.

(** ** Predicates that are bare patterns *)

Lemma blank_matches : forall p b v, bindings p v <> [] -> matches b (blank p) v.
Proof.
  intros p b v B. unfold bindings in B. destruct (ways p v) as [| bs l] eqn:W; [now destruct B |].
  assert (N : is_nil (ways (blank p) v) = false) by (rewrite blank_ways, W; reflexivity).
  destruct (ways (blank p) v) as [| cs m] eqn:W'; [discriminate |]. apply ways_iff. exists cs.
  assert (I : In cs (ways (blank p) v)) by (rewrite W'; simpl; auto). split; auto.
  apply ways_places in I. assert (E : places (blank p) = []).
  { clear. induction p as [w | y | | fields IH | items IH | p IH] using pattern_induction; simpl; auto.
    - induction IH as [| f fields H _ IHF]; simpl; auto. now rewrite H.
    - induction IH as [| f fields H _ IHF]; simpl; auto. now rewrite H. }
  rewrite E in I. destruct cs; [apply respects_nil | discriminate].
Qed.

(** A predicate without guards whose variables stand once is its pattern without names. *)
Definition bare_as (q : predicate) (p : pattern) : bool :=
  is_nil (snd q) && all_different (places (fst q)) && same_pattern (blank (fst q)) p.

Lemma bare_as_meets : forall q p e, bare_as q p = true -> late e = false ->
  (meets q e = true <-> forall b, matches b p (content e)).
Proof.
  intros [q gs] p e B L. unfold bare_as in B. cbn [fst snd] in B. rewrite !andb_true_iff in B.
  destruct B as [[N D] S]. apply is_nil_iff in N. apply same_pattern_eq in S. subst gs p.
  unfold meets. cbn [fst snd forallb]. rewrite L. simpl. split.
  - intros M b. apply blank_matches. intros E. rewrite E in M. discriminate.
  - intros M. specialize (M (fun _ => Null)). apply (blank_sound q _ _ D) in M.
    destruct (bindings q (content e)); [congruence | reflexivity].
Qed.
