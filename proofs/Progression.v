(** * Certifying LTLf texts by progression

    The derivative of a formula by a letter holds on the rest of the trace when the formula holds on
    the whole.  Conjunctions and disjunctions are kept sorted and without repetition, so that finitely
    many derivatives occur in practice.  A text is certified by exploring its derivatives beside the
    automaton. *)

Require Import List Bool Arith Lia.
Require Import RVAFT.Language RVAFT.Definition RVAFT.Search RVAFT.Plain RVAFT.Automaton RVAFT.Acceptance.
Require Import RVAFT.Exploration RVAFT.Ltlf.
Import ListNotations.

(** ** Sorted junctions *)

Definition rank (f : formula) : nat :=
  match f with
  | Truth => 0 | Falsity => 1 | Atom _ => 2 | Neg _ => 3 | Conj _ _ => 4 | Disj _ _ => 5
  | Next _ => 6 | Eventually _ => 7 | Until _ _ => 8
  end.

Fixpoint compare_formula (f g : formula) : comparison :=
  match f, g with
  | Truth, Truth | Falsity, Falsity => Eq
  | Atom p, Atom q => Nat.compare p q
  | Neg f, Neg g | Next f, Next g | Eventually f, Eventually g => compare_formula f g
  | Conj f f', Conj g g' | Disj f f', Disj g g' | Until f f', Until g g' =>
    match compare_formula f g with Eq => compare_formula f' g' | c => c end
  | _, _ => Nat.compare (rank f) (rank g)
  end.

Definition same_formula (f g : formula) : bool := match compare_formula f g with Eq => true | _ => false end.

Lemma compare_formula_eq : forall f g, compare_formula f g = Eq -> f = g.
Proof.
  induction f; destruct g; simpl; try discriminate; auto; intros H;
    try (apply Nat.compare_eq in H; congruence); try (f_equal; auto; fail).
  all: destruct (compare_formula f1 g1) eqn:C; try discriminate; f_equal; auto.
Qed.

Lemma compare_formula_refl : forall f, compare_formula f f = Eq.
Proof. induction f; simpl; auto using Nat.compare_refl; now rewrite IHf1. Qed.

Lemma same_formula_iff : forall f g, same_formula f g = true <-> f = g.
Proof.
  intros f g; unfold same_formula; split; [| intros ->; now rewrite compare_formula_refl].
  destruct (compare_formula f g) eqn:C; try discriminate. intros _; now apply compare_formula_eq.
Qed.

Fixpoint merge (l : list formula) : list formula -> list formula :=
  fix into (m : list formula) : list formula :=
    match l, m with
    | [], _ => m
    | _, [] => l
    | f :: l', g :: m' =>
      match compare_formula f g with
      | Lt => f :: merge l' m
      | Gt => g :: into m'
      | Eq => f :: merge l' m'
      end
    end.

Lemma in_merge : forall l m f, In f (merge l m) <-> In f l \/ In f m.
Proof.
  induction l as [| g l IH]; [destruct m; simpl; tauto |]. induction m as [| h m IHm]; intros f.
  - simpl. tauto.
  - change (merge (g :: l) (h :: m)) with
      (match compare_formula g h with
       | Lt => g :: merge l (h :: m) | Gt => h :: merge (g :: l) m | Eq => g :: merge l m end).
    destruct (compare_formula g h) eqn:C.
    + apply compare_formula_eq in C; subst. simpl. rewrite IH. tauto.
    + cbn [In]. rewrite IH. simpl. tauto.
    + cbn [In]. rewrite IHm. simpl. tauto.
Qed.

Fixpoint conj_of (l : list formula) : formula :=
  match l with [] => Truth | [f] => f | f :: l => Conj f (conj_of l) end.
Fixpoint disj_of (l : list formula) : formula :=
  match l with [] => Falsity | [f] => f | f :: l => Disj f (disj_of l) end.

(** The spine of a sorted junction, without sorting it again. *)
Fixpoint conj_spine (f : formula) : list formula :=
  match f with Conj f g => f :: conj_spine g | Truth => [] | _ => [f] end.
Fixpoint disj_spine (f : formula) : list formula :=
  match f with Disj f g => f :: disj_spine g | Falsity => [] | _ => [f] end.

Definition is_falsity (f : formula) : bool := match f with Falsity => true | _ => false end.
Definition is_truth (f : formula) : bool := match f with Truth => true | _ => false end.

(** Junctions of sorted operands.  An operand that holds less often makes others superfluous: in a
    conjunction, a disjunction with one of the other conjuncts; and dually. *)
Definition absorbed_by (parts : formula -> list formula) (l : list formula) (f : formula) : bool :=
  existsb (fun g => negb (same_formula f g) && existsb (same_formula g) (parts f)) l.

Definition both (f g : formula) : formula :=
  let l := merge (conj_spine f) (conj_spine g) in
  if existsb is_falsity l then Falsity
  else conj_of (filter (fun f => match f with Disj _ _ => negb (absorbed_by disj_spine l f) | _ => true end) l).

Definition either (f g : formula) : formula :=
  let l := merge (disj_spine f) (disj_spine g) in
  if existsb is_truth l then Truth
  else disj_of (filter (fun f => match f with Conj _ _ => negb (absorbed_by conj_spine l f) | _ => true end) l).

Definition negation (f : formula) : formula :=
  match f with Truth => Falsity | Falsity => Truth | Neg f => f | _ => Neg f end.

(** ** Derivatives *)

(** Whether the formula holds on the empty trace. *)
Fixpoint at_end (f : formula) : bool :=
  match f with
  | Truth => true
  | Falsity | Atom _ | Next _ | Eventually _ | Until _ _ => false
  | Neg f => negb (at_end f)
  | Conj f g => at_end f && at_end g
  | Disj f g => at_end f || at_end g
  end.

(** [F 1]: the rest of the trace is not empty. *)
Definition goes_on : formula := Eventually Truth.

(** Constants and junctions are simplified once, in the text and below its temporal operators. *)
Fixpoint simplified (f : formula) : formula :=
  match f with
  | Truth | Falsity | Atom _ => f
  | Neg f => negation (simplified f)
  | Conj f g => both (simplified f) (simplified g)
  | Disj f g => either (simplified f) (simplified g)
  | Next f => Next (simplified f)
  | Eventually f => Eventually (simplified f)
  | Until f g => Until (simplified f) (simplified g)
  end.

Fixpoint derivative (f : formula) (a : letter) : formula :=
  match f with
  | Truth => Truth
  | Falsity => Falsity
  | Atom p => if member p a then Truth else Falsity
  | Neg f => negation (derivative f a)
  | Conj f g => both (derivative f a) (derivative g a)
  | Disj f g => either (derivative f a) (derivative g a)
  | Next f => if at_end f then both goes_on f else f
  | Eventually g => either (derivative g a) f
  | Until g h => either (derivative h a) (both (derivative g a) f)
  end.

Section Progression.
Context {E : Type}.
Variable satisfies : nat -> E -> bool.
Notation holds := (holds satisfies).

Lemma holds_conj_of : forall l u, holds (conj_of l) u = forallb (fun f => holds f u) l.
Proof.
  induction l as [| f [| g l] IH]; intros u; auto; [simpl; now rewrite andb_true_r |].
  change (holds (conj_of (f :: g :: l)) u) with (holds f u && holds (conj_of (g :: l)) u). now rewrite IH.
Qed.

Lemma holds_disj_of : forall l u, holds (disj_of l) u = existsb (fun f => holds f u) l.
Proof.
  induction l as [| f [| g l] IH]; intros u; auto; [simpl; now rewrite orb_false_r |].
  change (holds (disj_of (f :: g :: l)) u) with (holds f u || holds (disj_of (g :: l)) u). now rewrite IH.
Qed.

Lemma holds_conj_spine : forall f u, holds f u = forallb (fun f => holds f u) (conj_spine f).
Proof. induction f; intros u; simpl; rewrite ?andb_true_r; auto. now rewrite IHf2. Qed.

Lemma holds_disj_spine : forall f u, holds f u = existsb (fun f => holds f u) (disj_spine f).
Proof. induction f; intros u; simpl; rewrite ?orb_false_r; auto. now rewrite IHf2. Qed.

Lemma forallb_merge : forall (p : formula -> bool) l m, forallb p (merge l m) = forallb p l && forallb p m.
Proof.
  intros p l m. apply eq_true_iff_eq. rewrite andb_true_iff, !forallb_forall. split.
  - intros H; split; intros f I; apply H, in_merge; auto.
  - intros [H K] f I. apply in_merge in I as [I | I]; auto.
Qed.

Lemma existsb_merge : forall (p : formula -> bool) l m, existsb p (merge l m) = existsb p l || existsb p m.
Proof.
  intros p l m. apply eq_true_iff_eq. rewrite orb_true_iff, !existsb_exists. split.
  - intros (f & I & H). apply in_merge in I as [I | I]; eauto.
  - intros [(f & I & H) | (f & I & H)]; exists f; split; auto; apply in_merge; auto.
Qed.

(** The size bounds a descent through absorbing operands. *)
Fixpoint size (f : formula) : nat :=
  match f with
  | Truth | Falsity | Atom _ => 1
  | Neg f | Next f | Eventually f => S (size f)
  | Conj f g | Disj f g | Until f g => S (size f + size g)
  end.

Lemma size_conj_spine : forall f g, In g (conj_spine f) -> g = f \/ size g < size f.
Proof.
  induction f; simpl; intros h I; try (destruct I as [<- | []]; auto; fail); try tauto.
  destruct I as [<- | I]; [right; lia |]. right. destruct (IHf2 h I) as [-> |]; lia.
Qed.

Lemma size_disj_spine : forall f g, In g (disj_spine f) -> g = f \/ size g < size f.
Proof.
  induction f; simpl; intros h I; try (destruct I as [<- | []]; auto; fail); try tauto.
  destruct I as [<- | I]; [right; lia |]. right. destruct (IHf2 h I) as [-> |]; lia.
Qed.

Lemma absorbed_smaller : forall parts l f, (forall g, In g (parts f) -> g = f \/ size g < size f) ->
  absorbed_by parts l f = true -> exists g, In g l /\ In g (parts f) /\ size g < size f.
Proof.
  intros parts l f S A. unfold absorbed_by in A. apply existsb_exists in A as (g & I & H).
  apply andb_true_iff in H as [N H]. apply existsb_exists in H as (h & J & Q). apply same_formula_iff in Q as <-.
  exists g; repeat split; auto. destruct (S g J) as [-> | L]; auto.
  rewrite (proj2 (same_formula_iff f f) eq_refl) in N. discriminate.
Qed.

Lemma holds_both : forall f g u, holds (both f g) u = holds f u && holds g u.
Proof.
  intros f g u. rewrite (holds_conj_spine f), (holds_conj_spine g), <- forallb_merge. unfold both.
  set (l := merge _ _). destruct (existsb is_falsity l) eqn:F.
  - apply existsb_exists in F as (h & I & F). destruct h; try discriminate. simpl. symmetry.
    apply not_true_is_false. rewrite forallb_forall. intros H. specialize (H Falsity I). discriminate.
  - rewrite holds_conj_of. apply eq_true_iff_eq. rewrite !forallb_forall. split.
    + intros H. enough (K : forall n h, size h < n -> In h l -> holds h u = true) by eauto.
      induction n as [| n IH]; intros h L I; [lia |].
      destruct h; try (apply H, filter_In; auto; fail).
      destruct (absorbed_by disj_spine l (Disj h1 h2)) eqn:A; [| apply H, filter_In; rewrite A; auto].
      apply absorbed_smaller in A as (g' & J & P & SZ); [| intros; now apply size_disj_spine].
      rewrite holds_disj_spine. apply existsb_exists. exists g'; split; auto. apply IH; auto. lia.
    + intros H h I. apply filter_In in I as [I _]. auto.
Qed.

Lemma holds_either : forall f g u, holds (either f g) u = holds f u || holds g u.
Proof.
  intros f g u. rewrite (holds_disj_spine f), (holds_disj_spine g), <- existsb_merge. unfold either.
  set (l := merge _ _). destruct (existsb is_truth l) eqn:F.
  - apply existsb_exists in F as (h & I & F). destruct h; try discriminate. simpl. symmetry.
    apply existsb_exists. exists Truth; auto.
  - rewrite holds_disj_of. apply eq_true_iff_eq. rewrite !existsb_exists. split.
    + intros (h & I & H). apply filter_In in I as [I _]. eauto.
    + enough (K : forall n h, size h < n -> In h l -> holds h u = true ->
        exists h, In h (filter (fun f => match f with Conj _ _ => negb (absorbed_by conj_spine l f) | _ => true end) l)
                  /\ holds h u = true) by (intros (h & I & H); eauto).
      induction n as [| n IH]; intros h L I H; [lia |].
      destruct h; try (eexists; split; [apply filter_In; split; [exact I | reflexivity] | exact H]; fail).
      destruct (absorbed_by conj_spine l (Conj h1 h2)) eqn:A.
      * apply absorbed_smaller in A as (g' & J & P & SZ); [| intros; now apply size_conj_spine].
        apply (IH g'); auto; [lia |]. rewrite holds_conj_spine, forallb_forall in H. auto.
      * exists (Conj h1 h2); split; auto. apply filter_In; rewrite A; auto.
Qed.

Lemma holds_negation : forall f u, holds (negation f) u = negb (holds f u).
Proof. intros [] u; simpl; auto using negb_involutive. Qed.

Lemma holds_at_end : forall f, holds f [] = at_end f.
Proof. induction f; simpl; congruence. Qed.

Lemma holds_goes_on : forall u, holds goes_on u = negb (is_nil u).
Proof. intros []; reflexivity. Qed.

Lemma simplified_same : forall f u, holds (simplified f) u = holds f u.
Proof.
  induction f; intros u; cbn [simplified]; auto.
  - now rewrite holds_negation, IHf.
  - now rewrite holds_both, IHf1, IHf2.
  - now rewrite holds_either, IHf1, IHf2.
  - destruct u as [| e u]; auto. simpl. now rewrite IHf.
  - induction u as [| e u IH]; auto.
    change (holds (Eventually (simplified f)) (e :: u))
      with (holds (simplified f) (e :: u) || holds (Eventually (simplified f)) u).
    now rewrite IHf, IH.
  - induction u as [| e u IH]; auto.
    change (holds (Until (simplified f1) (simplified f2)) (e :: u)) with
      (holds (simplified f2) (e :: u) ||
       (holds (simplified f1) (e :: u) && holds (Until (simplified f1) (simplified f2)) u)).
    now rewrite IHf1, IHf2, IH.
Qed.

Fixpoint atoms (f : formula) : list nat :=
  match f with
  | Truth | Falsity => []
  | Atom p => [p]
  | Neg f | Next f | Eventually f => atoms f
  | Conj f g | Disj f g | Until f g => atoms f ++ atoms g
  end.

(** A letter agrees with an event on the atoms of the formula. *)
Definition agrees (a : letter) (e : E) (f : formula) : Prop := forall p, In p (atoms f) -> member p a = satisfies p e.

Lemma derivative_correct : forall f a e u, agrees a e f -> holds (derivative f a) u = holds f (e :: u).
Proof.
  induction f as [| | p | f IH | f IHf g IHg | f IHf g IHg | f IH | f IH | f IHf g IHg]; intros a e u A;
    cbn [derivative]; auto.
  - simpl. rewrite <- A by (simpl; auto). destruct (member p a); auto.
  - rewrite holds_negation, (IH a e) by auto. reflexivity.
  - rewrite holds_both, (IHf a e), (IHg a e) by (intros p I; apply A; simpl; apply in_app_iff; auto). reflexivity.
  - rewrite holds_either, (IHf a e), (IHg a e) by (intros p I; apply A; simpl; apply in_app_iff; auto). reflexivity.
  - change (holds (Next f) (e :: u)) with (negb (is_nil u) && holds f u). destruct (at_end f) eqn:Z.
    + now rewrite holds_both, holds_goes_on.
    + destruct u; simpl; auto. rewrite holds_at_end; auto.
  - rewrite holds_either, (IH a e) by auto. reflexivity.
  - rewrite holds_either, holds_both, (IHf a e), (IHg a e) by (intros p I; apply A; simpl; apply in_app_iff; auto).
    reflexivity.
Qed.
End Progression.

(** ** Derivatives have no new atoms *)

Lemma atoms_both : forall f g p, In p (atoms (both f g)) -> In p (atoms f) \/ In p (atoms g).
Proof.
  intros f g p I.
  assert (C : forall l, In p (atoms (conj_of l)) -> exists h, In h l /\ In p (atoms h)).
  { induction l as [| h [| h' l] IH]; simpl; [tauto | eauto |]. intros J. apply in_app_iff in J as [J | J]; eauto.
    destruct (IH J) as (h'' & K & L). exists h''; auto. }
  assert (S : forall h f, In h (conj_spine f) -> In p (atoms h) -> In p (atoms f)).
  { intros h f0; induction f0; simpl; intros J K; try (destruct J as [<- | []]; auto; fail); try tauto.
    apply in_app_iff. destruct J as [<- | J]; auto. }
  unfold both in I. destruct (existsb is_falsity _); [destruct I |]. apply C in I as (h & J & K).
  apply filter_In in J as [J _]. apply in_merge in J as [J | J]; eauto.
Qed.

Lemma atoms_either : forall f g p, In p (atoms (either f g)) -> In p (atoms f) \/ In p (atoms g).
Proof.
  intros f g p I.
  assert (C : forall l, In p (atoms (disj_of l)) -> exists h, In h l /\ In p (atoms h)).
  { induction l as [| h [| h' l] IH]; simpl; [tauto | eauto |]. intros J. apply in_app_iff in J as [J | J]; eauto.
    destruct (IH J) as (h'' & K & L). exists h''; auto. }
  assert (S : forall h f, In h (disj_spine f) -> In p (atoms h) -> In p (atoms f)).
  { intros h f0; induction f0; simpl; intros J K; try (destruct J as [<- | []]; auto; fail); try tauto.
    apply in_app_iff. destruct J as [<- | J]; auto. }
  unfold either in I. destruct (existsb is_truth _); [destruct I |]. apply C in I as (h & J & K).
  apply filter_In in J as [J _]. apply in_merge in J as [J | J]; eauto.
Qed.

Lemma atoms_negation : forall f, atoms (negation f) = atoms f.
Proof. intros []; reflexivity. Qed.

Lemma atoms_derivative : forall a f, incl (atoms (derivative f a)) (atoms f).
Proof.
  intros a; induction f as [| | q | f IH | f IHf g IHg | f IHf g IHg | f IH | f IH | f IHf g IHg]; intros p I;
    cbn [derivative] in I; auto.
  - destruct (member q a); destruct I.
  - rewrite atoms_negation in I. now apply IH.
  - simpl. apply in_app_iff. apply atoms_both in I as [I | I]; auto.
  - simpl. apply in_app_iff. apply atoms_either in I as [I | I]; auto.
  - destruct (at_end f); auto. apply atoms_both in I as [[] | I]; auto.
  - apply atoms_either in I as [I | I]; simpl in *; auto.
  - simpl. apply in_app_iff. apply atoms_either in I as [I | I]; auto. apply atoms_both in I as [I | I]; auto.
    simpl in I. now apply in_app_iff in I.
Qed.

Lemma atoms_simplified : forall f, incl (atoms (simplified f)) (atoms f).
Proof.
  induction f as [| | q | f IH | f IHf g IHg | f IHf g IHg | f IH | f IH | f IHf g IHg]; intros p I;
    cbn [simplified] in I; simpl in *; auto.
  - rewrite atoms_negation in I. now apply IH.
  - apply in_app_iff. apply atoms_both in I as [I | I]; auto.
  - apply in_app_iff. apply atoms_either in I as [I | I]; auto.
  - apply in_app_iff. apply in_app_iff in I as [I | I]; auto.
Qed.

(** ** The certificate *)

Fixpoint hash_formula (mix : mixing) (f : formula) : nat :=
  match f with
  | Truth => 1
  | Falsity => 2
  | Atom p => mix 3 p
  | Neg f => mix 4 (hash_formula mix f)
  | Conj f g => mix (mix 5 (hash_formula mix f)) (hash_formula mix g)
  | Disj f g => mix (mix 6 (hash_formula mix f)) (hash_formula mix g)
  | Next f => mix 7 (hash_formula mix f)
  | Eventually f => mix 8 (hash_formula mix f)
  | Until f g => mix (mix 9 (hash_formula mix f)) (hash_formula mix g)
  end.

Definition formula_moves (f : formula) (possible : list letter) : list formula := map (derivative f) possible.
Definition formula_fits (f : formula) (q : state) : bool := Bool.eqb (at_end f) (accepting q).

(** The predicates are those of the scenarios and of the text; the possible letters are over these. *)
Definition certify_ltlf (mix : mixing) (s : semantics) (xs : list shape) (predicates : list nat)
  (possible : list letter)
  (fuel : nat) (f : formula) : outcome :=
  if all_among (alphabet xs) predicates && all_among (atoms f) predicates
  then compare_with_automaton mix same_formula (hash_formula mix) formula_moves formula_fits s
         (map rows xs) possible fuel
         (simplified f)
  else Exhausted.

Section Certificate.
Context {E : Type}.
Variable satisfies : nat -> E -> bool.
Notation relevant := (relevant satisfies).
Notation Rel := (fun e => relevant e = true).
Notation plain := (plain satisfies).
Notation holds := (holds satisfies).

Lemma progression_correct : forall predicates u f, incl (atoms f) predicates ->
  at_end (fold_left derivative (letters satisfies predicates u) f) = holds f u.
Proof.
  intros ps; induction u as [| e u IH]; intros f A; simpl.
  - symmetry; apply holds_at_end.
  - rewrite IH.
    + apply derivative_correct. intros p I. apply member_letter; auto.
    + eapply incl_tran; [apply atoms_derivative | exact A].
Qed.

(** A certified formula holds on exactly the traces with a detection. *)
Theorem certify_ltlf_language : forall mix s xs predicates possible fuel f,
  certify_ltlf mix s xs predicates possible fuel f = Certified ->
  (forall e, In (letter_of satisfies predicates e) possible) ->
  forall u, holds f u = true <-> Detected Rel (Scenarios (map plain xs)) s u.
Proof.
  intros mix s xs ps possible fuel f C P u. unfold certify_ltlf in C.
  destruct (all_among (alphabet xs) ps && all_among (atoms f) ps) eqn:A; [| discriminate].
  apply andb_true_iff in A as [A B]. apply all_among_incl in A, B.
  assert (F : Forall (fun l => In l possible) (letters satisfies ps u)).
  { apply Forall_forall. intros l I. apply in_map_iff in I as (e & <- & _). auto. }
  pose proof (compare_sound mix same_formula (hash_formula mix) formula_moves derivative formula_fits same_formula_iff
    (fun _ _ => eq_refl) s (map rows xs) possible fuel _ C _ F) as K.
  unfold formula_fits in K. apply eqb_prop in K. rewrite progression_correct in K.
  2:{ eapply incl_tran; [apply atoms_simplified | exact B]. }
  rewrite simplified_same in K. rewrite K. rewrite <- automaton_accepts with (predicates := ps).
  - fold (automaton_after satisfies ps s xs u).
    destruct (automaton_after satisfies ps s xs u); simpl; split; congruence.
  - apply A; simpl; auto.
  - apply Forall_forall. intros x I p J. apply A. right. apply in_flat_map; eauto.
Qed.
End Certificate.
