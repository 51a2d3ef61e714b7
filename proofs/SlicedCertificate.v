(** * Certified texts over slices have the verdict of the tree

    A text of LTLf or HOA reads letters of atoms, which may have variables.  It is compared with the
    scenarios of the tree over all letters that events can make under assignments; nothing is assumed of
    assignments of different events.  [certify_text_ltlf_correct], [certify_text_hoa_correct]: a certified
    text has the verdict of the tree on every trace, over its slices. *)

Require Import List Bool Arith ZArith Lia.
Require Import RVAFT.Values RVAFT.Language RVAFT.Definition RVAFT.Search RVAFT.Conditions RVAFT.Scenarios.
Require Import RVAFT.Monitor RVAFT.Plain RVAFT.Automaton RVAFT.Acceptance RVAFT.Exploration RVAFT.Hoa RVAFT.Ltlf.
Require Import RVAFT.Progression RVAFT.Letters RVAFT.Validator RVAFT.PlainTree RVAFT.Relevance.
Require Import RVAFT.Slices RVAFT.Clocks RVAFT.SlicedTree.
Import ListNotations.

(** ** Numbered atoms *)

Definition same_time (a b : option nat) : bool :=
  match a, b with Some x, Some y => Nat.eqb x y | None, None => true | _, _ => false end.

Definition same_atom (q r : atom) : bool :=
  same_pattern (atom_pattern q) (atom_pattern r) && same_time (atom_time q) (atom_time r) &&
  all2 same_guard (atom_guards q) (atom_guards r).

Lemma same_time_eq : forall a b, same_time a b = true -> a = b.
Proof. intros [x |] [y |] E; try discriminate; auto. apply Nat.eqb_eq in E. congruence. Qed.

Lemma same_atom_eq : forall q r, same_atom q r = true -> q = r.
Proof.
  intros [p x g] [p' x' g'] E. unfold same_atom in E. simpl in E. rewrite !andb_true_iff in E.
    destruct E as [[P T] G].
  apply same_pattern_eq in P as ->. apply same_time_eq in T as ->. f_equal.
  eapply all2_eq; [| exact G]. apply Forall_forall. intros h _. apply same_guard_eq.
Qed.

Fixpoint place (q : atom) (qs : list atom) : nat :=
  match qs with [] => 0 | r :: qs => if same_atom q r then 0 else S (place q qs) end.

Lemma place_nth : forall q qs, place q qs < length qs -> nth_error qs (place q qs) = Some q.
Proof.
  intros q; induction qs as [| r qs IH]; simpl; intros L; [lia |].
  destruct (same_atom q r) eqn:E; [apply same_atom_eq in E; subst; auto |]. apply IH; lia.
Qed.

Definition placed (qs : list atom) (q : atom) : bool := place q qs <? length qs.

Section Tree.
Variable t : tree.
Variable ps : list predicate.     (* numbers from 1: predicates whose variables are their own *)
Variable qs : list atom.          (* the numbers after these *)

Definition atom_number (q : atom) : nat := S (length ps) + place q qs.

(** What an event satisfies under an assignment; number 0 is relevance. *)
Definition slice_satisfies : nat -> sliced -> bool :=
  let closed := satisfies t ps in
  fun k y => if k <=? length ps then closed k (fst y)
    else match nth_error qs (k - S (length ps)) with Some q => observes q y | None => false end.

Lemma atom_satisfied : forall q y, placed qs q = true -> slice_satisfies (atom_number q) y = observes q y.
Proof.
  intros q y L. apply Nat.ltb_lt in L. unfold slice_satisfies, atom_number.
  replace (S (length ps) + place q qs <=? length ps) with false by (symmetry; apply Nat.leb_gt; lia).
  replace (S (length ps) + place q qs - S (length ps)) with (place q qs) by lia. now rewrite place_nth.
Qed.

Lemma slice_relevant : forall y, relevant slice_satisfies y = relevant_event t (fst y).
Proof. reflexivity. Qed.

(** ** The scenarios of the tree *)

Definition clocked_guards (w : selection) : list (list guard) :=
  selected_scenarios (fun guards part _ _ => scenario_guards t part guards) t w.

(** The occurrences whose time some guard names. *)
Definition timed_in (w : selection) : occurrence -> bool :=
  let used := nodup Nat.eq_dec (flat_map (flat_map variables) (clocked_guards w)) in
  fun o => Conditions.member (clock t o) used.

Definition slice_shape (timed : occurrence -> bool) (guards : list guard) (part : nat -> list occurrence)
  (os : list occurrence) (before : occurrence -> occurrence -> bool) : shape :=
  let guards := scenario_guards t part guards in
  Shape os before (fun o => match scenario_atom t timed guards o with Some q => atom_number q | None => relevance
    end).

Definition slice_shapes (w : selection) : list shape := selected_scenarios (slice_shape (timed_in w)) t w.

(** The atoms of each scenario. *)
Definition shape_atoms (w : selection) : list (list atom) :=
  let timed := timed_in w in
  selected_scenarios (fun guards part os _ =>
    let guards := scenario_guards t part guards in
    flat_map (fun o => match scenario_atom t timed guards o with Some q => [q] | None => [] end) os) t w.

Definition all_timed (w : selection) : bool :=
  let timed := timed_in w in
  basic t && forallb (fun b => b) (selected_scenarios (fun guards part _ _ => guards_timed t timed part guards) t w).

(** The atom of a text binds the variables of an atom of the tree when both have the same pattern, and the
    former has no more guards.  An atom without variables needs none. *)
Definition binds_for (q q' : atom) : bool :=
  same_pattern (atom_pattern q') (atom_pattern q) && same_time (atom_time q') (atom_time q) &&
  forallb (fun g => existsb (same_guard g) (atom_guards q)) (atom_guards q').

Definition text_binds (w : selection) (atoms : list atom) : bool :=
  forallb (forallb (fun q => is_nil (atom_variables q) || existsb (binds_for q) atoms)) (shape_atoms w).

Definition all_placed (w : selection) : bool := forallb (forallb (placed qs)) (shape_atoms w).

(** The atom of an occurrence is among those of its scenario. *)
Lemma occurrence_atom : forall w r chosen o, In r (resolutions t) -> selected t w r = true ->
  constants_hold (guards_of t r) = true -> In chosen (lasts t r) ->
  Scenarios.acyclic (precedes (node_pairs t r) (end_pairs t r (last_in chosen))) (occurrences_of t r) = true ->
  In o (occurrences_of t r) -> exists q l,
    scenario_atom t (timed_in w) (scenario_guards t (parts t r) (guards_of t r)) o = Some q /\
    In l (shape_atoms w) /\ In q l.
Proof.
  intros w r chosen o R S C L A O. set (guards := scenario_guards t (parts t r) (guards_of t r)).
  assert (Q : exists q, scenario_atom t (timed_in w) guards o = Some q).
  { apply occurrences_iff in O as (_ & O & _). unfold scenario_atom.
    destruct (on (node_at t (fst o))); [eexists; reflexivity | congruence]. }
  destruct Q as (q & Q).
  exists q, (flat_map (fun o => match scenario_atom t (timed_in w) guards o with Some q => [q] | None => [] end)
    (occurrences_of t r)). split; [auto | split].
  - apply in_scenarios. exists r, chosen. repeat split; auto.
  - apply in_flat_map. exists o; split; auto. rewrite Q. simpl; auto.
Qed.

Section Scenarios.
Variable w : selection.
Variable atoms : list atom.
Hypothesis well : WellFormed t.
Hypothesis atoms_placed : all_placed w = true.
Hypothesis timed : all_timed w = true.
Hypothesis bound_by_text : text_binds w atoms = true.

Notation Rel := (fun e => relevant_event t e = true).
Notation SliceRel := (fun y => relevant slice_satisfies y = true).
Notation slice_plans := (map (plain slice_satisfies) (slice_shapes w)).

Lemma in_shapes : forall x, In x (slice_shapes w) <-> exists r chosen,
  In r (resolutions t) /\ selected t w r = true /\ constants_hold (guards_of t r) = true /\ In chosen (lasts t r) /\
  let before := precedes (node_pairs t r) (end_pairs t r (last_in chosen)) in
  Scenarios.acyclic before (occurrences_of t r) = true /\
  x = slice_shape (timed_in w) (guards_of t r) (parts t r) (occurrences_of t r) before.
Proof. intros x. apply in_scenarios. Qed.

Lemma shapes_acyclic : Forall acyclic (slice_shapes w).
Proof.
  apply Forall_forall. intros x I. apply in_shapes in I as (r & chosen & _ & _ & _ & _ & A & ->).
  apply acyclic_iff in A as [rank A]. exists rank. exact A.
Qed.

(** What is checked of all scenarios holds of each. *)
Lemma of_scenario_atoms : forall r chosen o, In r (resolutions t) -> selected t w r = true ->
  constants_hold (guards_of t r) = true -> In chosen (lasts t r) ->
  Scenarios.acyclic (precedes (node_pairs t r) (end_pairs t r (last_in chosen))) (occurrences_of t r) = true ->
  let guards := scenario_guards t (parts t r) (guards_of t r) in
  guards_timed t (timed_in w) (parts t r) (guards_of t r) = true /\
  (In o (occurrences_of t r) -> exists q, scenario_atom t (timed_in w) guards o = Some q /\ placed qs q = true /\
     (atom_variables q = [] \/ exists q', In q' atoms /\ binds_for q q' = true)).
Proof.
  intros r chosen o R S C L A. split.
  - assert (T := timed). unfold all_timed in T. apply andb_true_iff in T as [_ T]. rewrite forallb_forall in T.
    apply T, in_scenarios.
    exists r, chosen. repeat split; auto.
  - intros O. destruct (occurrence_atom w r chosen o R S C L A O) as (q & l & Q & IL & IQ). exists q; split; auto.
    unfold all_placed in atoms_placed. unfold text_binds in bound_by_text.
    rewrite forallb_forall in atoms_placed, bound_by_text.
    assert (PL := atoms_placed l IL). assert (BI := bound_by_text l IL). rewrite forallb_forall in PL, BI.
    split; auto. apply BI, orb_true_iff in IQ as [N | IQ]; [left; now apply is_nil_iff | right].
    now apply existsb_exists in IQ.
Qed.

Lemma binds_for_iff : forall q q', binds_for q q' = true ->
  atom_pattern q' = atom_pattern q /\ atom_time q' = atom_time q /\ incl (atom_guards q') (atom_guards q).
Proof.
  intros q q' B. unfold binds_for in B. rewrite !andb_true_iff in B. destruct B as [[P T] G].
  split; [now apply same_pattern_eq | split; [now apply same_time_eq |]]. rewrite forallb_forall in G.
  intros g I. apply G, existsb_exists in I as (h & I & E). apply same_guard_eq in E. now subst.
Qed.

Lemma relevant_at_slice : forall p i, RelevantAt SliceRel p i <-> RelevantAt Rel (map fst p) i.
Proof.
  intros p i. unfold RelevantAt. split.
  - intros ([e b] & N & R). exists e. split; [exact (map_nth_error fst _ _ N) | exact R].
  - intros (e & N & R). destruct (nth_error p i) as [[e' b] |] eqn:Q.
    + apply (map_nth_error fst) in Q. rewrite N in Q. injection Q as ->. exists (e', b); auto.
    + apply nth_error_None in Q. assert (i < length (map fst p)) by (apply nth_error_Some; congruence).
      rewrite map_length in H. lia.
Qed.

(** A match, and a partial match, of a slice with the same occurrences use positions that those of the trace may use. *)
Lemma positions_slice : forall s p position (m : assigned event) (m' : assigned sliced), domain m' = domain m ->
  (match_positions SliceRel s p (Used position m') <-> match_positions Rel s (map fst p) (Used position m)) /\
  (partial_positions SliceRel s p (Used position m') <-> partial_positions Rel s (map fst p) (Used position m)).
Proof.
  intros s p position m m' D. apply positions_same; [now rewrite map_length | apply relevant_at_slice |].
  intros i. unfold Used. now rewrite D.
Qed.

(** ** Matches of the tree and of its slices *)

(** A plan of the tree with the shape of the same scenario. *)
Definition Paired (c : plan event) (x : shape) : Prop :=
  (forall p position m, Growing p -> Partial (denoted (plain slice_satisfies x)) p position m ->
     exists m', domain m' = domain m /\ Partial (denoted c) (map fst p) position m') /\
  (forall u position m, Partial (denoted c) u position m ->
     exists p m', Slice atoms u p /\ domain m' = domain m /\
       Partial (denoted (plain slice_satisfies x)) p position m') /\
  plan_occurrences c = shape_occurrences x.

Lemma timed_basic : basic t = true.
Proof. unfold all_timed in timed. now apply andb_true_iff in timed. Qed.

Lemma paired_shapes : (forall x, In x (slice_shapes w) -> exists c, In c (plans t w) /\ Paired c x) /\
  (forall c, In c (plans t w) -> exists x, In x (slice_shapes w) /\ Paired c x).
Proof.
  assert (P : forall r chosen, In r (resolutions t) -> selected t w r = true ->
    constants_hold (guards_of t r) = true ->
    In chosen (lasts t r) ->
    let before := precedes (node_pairs t r) (end_pairs t r (last_in chosen)) in
    Scenarios.acyclic before (occurrences_of t r) = true ->
    Paired (Plan (occurrences_of t r) before (consistent t (guards_of t r) (parts t r)))
           (slice_shape (timed_in w) (guards_of t r) (parts t r) (occurrences_of t r) before)).
  { intros r chosen R S C L before A. assert (RE := proj1 (resolutions_iff t r well) R).
    assert (ON := fun o => of_scenario_atoms r chosen o R S C L A). cbv zeta in ON.
    destruct (ON (0, 0)) as [T _].
    assert (REQ : forall o, In o (occurrences_of t r) -> exists q,
      scenario_atom t (timed_in w) (scenario_guards t (parts t r) (guards_of t r)) o = Some q /\
      forall y, slice_satisfies (match scenario_atom t (timed_in w)
        (scenario_guards t (parts t r) (guards_of t r)) o with Some q => atom_number q | None => relevance end) y =
        observes q y).
    { intros o O. destruct (proj2 (ON o) O) as (q & Q & PL & _). exists q; split; auto. intros y. rewrite Q.
      now apply atom_satisfied. }
    split; [| split; [| reflexivity]].
    - intros p position m G H. exists (forget m). split; [apply forget_domain |].
      eapply (from_slice t r (timed_in w) before C timed_basic T slice_satisfies _ REQ); eauto.
    - intros u position m H. eapply (to_slice t r (timed_in w) before RE timed_basic T slice_satisfies _ REQ); eauto.
      intros o q O Q. destruct (proj2 (ON o) O) as (q0 & Q0 & _ & B). rewrite Q in Q0. injection Q0 as <-.
      destruct B as [N | (q' & I & B)]; [auto | right]. exists q'. split; auto. now apply binds_for_iff. }
  split.
  - intros x I. apply in_shapes in I as (r & chosen & R & S & C & L & A & ->).
    exists (Plan (occurrences_of t r) (precedes (node_pairs t r) (end_pairs t r (last_in chosen)))
              (consistent t (guards_of t r) (parts t r))). split; [| now apply P].
    apply in_plans. exists r, chosen. repeat split; auto.
  - intros c I. apply in_plans in I as (r & chosen & R & S & C & L & A & ->).
    eexists. split; [| now apply P]. apply in_shapes. exists r, chosen. repeat split; auto.
Qed.

Notation SliceDetected s p := (Detected SliceRel (Scenarios slice_plans) s p).
Notation SliceLeft s p := (Left SliceRel (Scenarios slice_plans) s p).

Lemma complete_domain : forall E F (c : plan E) (d : plan F) m m', plan_occurrences c = plan_occurrences d ->
  domain m = domain m' -> complete (denoted c) m -> complete (denoted d) m'.
Proof. intros E F c d m m' O D C. unfold complete in *. simpl in *. now rewrite <- O, <- D. Qed.

(** A trace has a match when one of its slices has one. *)
Theorem sliced_detected : forall s u, Detected Rel (Scenarios (plans t w)) s u <->
  exists p, Slice atoms u p /\ SliceDetected s p.
Proof.
  intros s u. split.
  - intros (v & v' & c & -> & (d & I & ->) & H). apply (quiet_match _ _ _ _ _ (denoted_quiet _ _)) in H
      as (position & m & P & C & M).
    destruct (proj2 paired_shapes d I) as (x & J & _ & T & O). destruct (T v position m P) as (p & m' & S & D & P').
    destruct (slice_keeps atoms v p v' S) as (p' & S'). exists (p ++ p'). split; auto.
    exists p, p', (denoted (plain slice_satisfies x)). split; auto. split; [exists (plain slice_satisfies x);
      split; auto;
      now apply in_map |]. apply quiet_match; [apply denoted_quiet |]. exists position, m'. split; auto. split.
    + eapply (complete_domain _ _ d); eauto.
    + apply (positions_slice s p position m m' D). now rewrite <- (slice_events atoms v p S).
  - intros (p & S & (v & v' & c & -> & (d & I & ->) & H)).
    apply (quiet_match _ _ _ _ _ (denoted_quiet _ _)) in H as (position & m & P & C & M).
    apply in_map_iff in I as (x & <- & I). destruct (proj1 paired_shapes x I) as (c & J & F & _ & O).
    assert (G := growing_prefix _ _ (slice_growing _ _ _ S)). destruct (F v position m G P) as (m' & D & P').
    apply slice_events in S as ->. rewrite map_app. exists (map fst v), (map fst v'), (denoted c). split; auto.
    split; [exists c; auto |]. apply quiet_match; [apply denoted_quiet |]. exists position, m'. split; auto. split.
    + eapply (complete_domain _ _ (plain slice_satisfies x)); eauto.
    + now apply (positions_slice s v position m' m (eq_sym D)).
Qed.

(** A trace has a partial match when one of its slices has one. *)
Theorem sliced_left : forall s u, Left Rel (Scenarios (plans t w)) s u <-> exists p, Slice atoms u p /\ SliceLeft s p.
Proof.
  intros s u. split.
  - intros (c & (d & I & ->) & H).
      apply (quiet_left _ _ _ _ _ (denoted_quiet _ _)) in H as (position & m & P & C & M).
    destruct (proj2 paired_shapes d I) as (x & J & _ & T & O). destruct (T u position m P) as (p & m' & S & D & P').
    exists p. split; auto. exists (denoted (plain slice_satisfies x)).
    split; [exists (plain slice_satisfies x); split; auto; now apply in_map |].
    apply quiet_left; [apply denoted_quiet |]. exists position, m'. split; auto. split.
    + intros C'. apply C. eapply (complete_domain _ _ (plain slice_satisfies x)); eauto.
    + apply (positions_slice s p position m m' D). now rewrite <- (slice_events atoms u p S).
  - intros (p & S & (c & (d & I & ->) & H)).
    apply (quiet_left _ _ _ _ _ (denoted_quiet _ _)) in H as (position & m & P & C & M).
    apply in_map_iff in I as (x & <- & I). destruct (proj1 paired_shapes x I) as (c & J & F & _ & O).
    destruct (F p position m (slice_growing _ _ _ S) P) as (m' & D & P').
    rewrite (slice_events _ _ _ S). exists (denoted c). split; [exists c; auto |].
    apply quiet_left; [apply denoted_quiet |]. exists position, m'. split; auto. split.
    + intros C'. apply C. eapply (complete_domain _ _ c); eauto.
    + now apply (positions_slice s p position m' m (eq_sym D)).
Qed.

Lemma tree_plans_verdict : basic t = true ->
  forall s u v, VerdictOfTree t w s u v <-> Verdict Rel (Scenarios (plans t w)) s u v.
Proof.
  intros simple s u v. unfold VerdictOfTree.
  assert (A : forall c, IsScenario t w [] c -> exists d, Scenarios (plans t w) d /\ Alike c d).
  { intros c I. destruct (plans_complete t w [] c well (basic_absences t simple) I) as (d & J & A).
    exists (denoted d); split; auto.
    exists d; auto. }
  assert (B : forall c, Scenarios (plans t w) c -> exists d, IsScenario t w [] d /\ Alike c d).
  { intros c (d & I & ->). exists (denoted d). split.
    - apply plans_sound; auto using basic_absences.
    - constructor; intros; reflexivity || (split; reflexivity). }
  split; apply verdict_same; auto; intros e.
  - symmetry. now apply relevant_event_iff.
  - now apply relevant_event_iff.
Qed.

(** The criterion: a text that accepts exactly the slices with a match has the verdict of the tree. *)
Theorem slices_verdict : forall s accepts, Forall (servable slice_satisfies s) (slice_shapes w) ->
  (forall p, accepts p <-> SliceDetected s p) ->
  forall u v, SliceVerdict atoms accepts u v <-> VerdictOfTree t w s u v.
Proof.
  intros s accepts V A u.
  assert (X : forall p v, TextVerdict accepts p v <-> Verdict SliceRel (Scenarios slice_plans) s p v)
    by (apply plain_text_verdict; auto using shapes_acyclic).
  assert (D := sliced_detected s u). assert (L := sliced_left s u).
  assert (T : (exists p, Slice atoms u p /\ TextVerdict accepts p Top) <-> Detected Rel (Scenarios (plans t w)) s u).
  { rewrite D. split; intros (p & S & H); exists p; split; auto; now apply (X p Top). }
  assert (B : (forall p, Slice atoms u p -> TextVerdict accepts p Bottom) <->
    ~ Detected Rel (Scenarios (plans t w)) s u /\ ~ Left Rel (Scenarios (plans t w)) s u).
  { rewrite D, L. split.
    - intros H. split; intros (p & S & K); specialize (H p S); apply (X p Bottom) in H; simpl in H; tauto.
    - intros [N M] p S. apply (X p Bottom). split; intros K; [apply N | apply M]; eauto. }
  intros v. rewrite (tree_plans_verdict timed_basic). destruct v; [exact T | exact B |].
  unfold SliceVerdict. cbv zeta. rewrite T, B.
  pose proof (verdict_correct (relevant_event t) s (plans t w) u (plans_lawful t w well)) as V'.
  simpl. destruct (verdict_of _); simpl in V'; tauto.
Qed.
End Scenarios.
End Tree.
