(** * Texts that accept traces: language equality suffices

    Section 5 of [docs/semantics.md]: a text of LTLf or HOA has the verdict true when the trace and
    every extension are accepted, false when neither it nor any extension is, and else unknown.  If
    the text accepts exactly the traces with a detection, this is the verdict of the definition,
    provided that every partial match can be extended by some event. *)

Require Import List Bool Arith Lia Permutation.
Require Import RVAFT.Language RVAFT.Definition RVAFT.Search RVAFT.Plain.
Import ListNotations.

Definition TextVerdict {E} (accepts : list E -> Prop) (u : list E) (v : verdict) : Prop :=
  match v with
  | Top => forall w, accepts (u ++ w)
  | Bottom => forall w, ~ accepts (u ++ w)
  | Unknown => ~ (forall w, accepts (u ++ w)) /\ ~ (forall w, ~ accepts (u ++ w))
  end.

Section Acceptance.
Context {E : Type}.
Variable relevant : E -> bool.
Notation Rel := (fun e => relevant e = true).
Notation Detected s plans := (Detected Rel (Scenarios plans) s).
Notation Left s plans := (Left Rel (Scenarios plans) s).
Notation Verdict s plans := (Verdict Rel (Scenarios plans) s).

(** Whether a semantics leaves irrelevant events out. *)
Definition projects (s : semantics) : Prop := s = Projected \/ s = Consecutive.

(** Every partial match of the scenario can be extended by some event, a relevant one where only
    these count. *)
Definition Extensible (s : semantics) (c : plan E) : Prop :=
  forall u m, In m (states relevant s c u) -> full c m = false ->
  exists e m', In m' (extend c e m) /\ (projects s -> relevant e = true).

Lemma detected_app : forall s plans u v, Detected s plans u -> Detected s plans (u ++ v).
Proof. intros s plans u v (w & w' & c & -> & S & M). exists w, (w' ++ v), c. rewrite app_assoc; auto. Qed.

Lemma states_not_nil : forall s c u v, states relevant s c (u ++ v) <> [] -> states relevant s c u <> [].
Proof.
  intros s c u v; induction v as [| e v IH] using rev_ind; [now rewrite app_nil_r |].
  rewrite app_assoc, states_snoc. intros H; apply IH; intros Q; rewrite Q in H. apply H; clear H IH.
  assert (Z : s = Consecutive -> start c = []).
  { intros ->. destruct (start c) as [| m l] eqn:S; auto. exfalso; revert Q. generalize (u ++ v) as w.
    induction w as [| f w IH] using rev_ind; [unfold states; simpl; congruence |].
    rewrite states_snoc. simpl. destruct (relevant f); auto. rewrite S. discriminate. }
  destruct s; simpl; auto; destruct (relevant e); auto. now rewrite Z.
Qed.

(** What is detected later is detected now, or some partial match is left now. *)
Lemma detected_later : forall s plans u v, Forall lawful plans ->
  Detected s plans (u ++ v) -> Detected s plans u \/ Left s plans u.
Proof.
  intros s plans u v L D. apply detected_states in D as (w & w' & c & Q & I & F); auto.
  apply app_eq_app in Q as (x & [[-> ->] | [-> ->]]).
  - left. apply detected_states; auto. exists w, x, c; auto.
  - assert (N : states relevant s c u <> []).
    { apply states_not_nil with x. intros Z. rewrite Z in F; discriminate. }
    destruct (states relevant s c u) as [| m l] eqn:S; [congruence |]. destruct (full c m) eqn:M.
    + left. apply detected_states; auto. exists u, [], c. rewrite app_nil_r, S; simpl. rewrite M; auto.
    + right. apply left_states; auto. exists c; split; auto. exists m; rewrite S; simpl; auto.
Qed.

(** False stays false. *)
Lemma bottom_stays : forall s plans u v, Forall lawful plans ->
  Verdict s plans u Bottom -> Verdict s plans (u ++ v) Bottom.
Proof.
  intros s plans u v L [N N']. split.
  - intros D. apply detected_later in D as [D | D]; auto.
  - intros D. apply left_states in D as (c & I & m & J & F); auto. apply N'. apply left_states; auto.
    assert (NN : states relevant s c u <> []) by (apply states_not_nil with v; intros Z; rewrite Z in J; destruct J).
    destruct (states relevant s c u) as [| m' l] eqn:S; [congruence |]. exists c; split; auto. exists m'.
    rewrite S; split; [simpl; auto |]. apply not_true_is_false. intros F'. apply N, detected_states; auto.
    exists u, [], c. rewrite app_nil_r, S; simpl. now rewrite F'.
Qed.

Definition undone (c : plan E) (m : assigned E) : nat :=
  length (filter (fun o => negb (among o (domain m))) (plan_occurrences c)).

Lemma undone_less : forall c e m m', In m' (extend c e m) -> undone c m' < undone c m.
Proof.
  intros c e m m' I. apply (in_extend relevant) in I as (o & -> & O & N & _). unfold undone; simpl.
  assert (W : forall l, length (filter (fun p => negb (same p o || among p (domain m))) l)
                        <= length (filter (fun p => negb (among p (domain m))) l)).
  { induction l as [| p l IH]; simpl; auto. destruct (same p o), (among p (domain m)); simpl; lia. }
  induction (plan_occurrences c) as [| p l IH]; simpl; [destruct O |].
  specialize (W l). destruct O as [-> | O].
  - rewrite same_refl. replace (among o (domain m)) with false; simpl; [lia |].
    symmetry; apply not_true_is_false. now rewrite among_iff.
  - specialize (IH O). destruct (same p o), (among p (domain m)); simpl; lia.
Qed.

Lemma left_detectable : forall s plans u, Forall lawful plans -> Forall (Extensible s) plans ->
  Left s plans u -> exists v, Detected s plans (u ++ v).
Proof.
  intros s plans u L X D. rewrite Forall_forall in X. apply left_states in D as (c & C & m & I & F); auto.
  enough (Y : forall n u m, undone c m < n -> In m (states relevant s c u) ->
              exists v m', In m' (states relevant s c (u ++ v)) /\ full c m' = true).
  { destruct (Y (S (undone c m)) u m) as (v & m' & J & F'); auto. exists v. apply detected_states; auto.
    exists (u ++ v), [], c. rewrite app_nil_r. repeat split; auto. apply existsb_exists; eauto. }
  clear u m I F. induction n as [| n IH]; intros u m H I; [lia |].
  destruct (full c m) eqn:F; [exists [], m; rewrite app_nil_r; auto |].
  destruct (X c C u m I F) as (e & m' & J & R).
  assert (K : In m' (states relevant s c (u ++ [e]))).
  { assert (In m' (flat_map (extend c e) (states relevant s c u))) by (apply in_flat_map; eauto).
    rewrite states_snoc. unfold projects in R.
    destruct s; simpl; auto; try rewrite R by auto; auto; apply in_app_iff; auto. }
  apply undone_less in J as U. destruct (IH (u ++ [e]) m') as (v & m'' & I' & F'); auto; [lia |].
  exists (e :: v), m''. rewrite <- app_assoc in I'. auto.
Qed.

(** The criterion: a text that accepts exactly the traces with a detection has the verdict of the
    definition on every trace. *)
Theorem text_verdict : forall s plans accepts, Forall lawful plans -> Forall (Extensible s) plans ->
  (forall u, accepts u <-> Detected s plans u) ->
  forall u v, TextVerdict accepts u v <-> Verdict s plans u v.
Proof.
  intros s plans accepts L X A u.
  assert (T : TextVerdict accepts u Top <-> Verdict s plans u Top).
  { simpl. split; [| intros D w; apply A, detected_app, D]. intros H; specialize (H []). rewrite app_nil_r in H.
    now apply A. }
  assert (B : TextVerdict accepts u Bottom <-> Verdict s plans u Bottom).
  { simpl. split.
    - intros H; split; intros D; [apply (H []), A; now rewrite app_nil_r |].
      apply left_detectable in D as [v D]; auto. now apply (H v), A.
    - intros [N N'] w D. apply A, detected_later in D as [D | D]; auto. }
  assert (U : Verdict s plans u Unknown <-> ~ Verdict s plans u Top /\ ~ Verdict s plans u Bottom).
  { simpl. split; [intros [H H']; tauto |]. intros [N N'].
    pose proof (verdict_correct relevant s plans u L) as V. destruct (verdict_of _); simpl in V; tauto. }
  intros []; auto. rewrite U, <- T, <- B. simpl. tauto.
Qed.
End Acceptance.

(** ** Plain scenarios: each occurrence can be served by some event *)

Section Plain.
Context {E : Type}.
Variable satisfies : nat -> E -> bool.
Notation relevant := (relevant satisfies).
Notation plain := (plain satisfies).

Definition acyclic (x : shape) : Prop := exists rank : occurrence -> nat, forall p o,
  In p (shape_occurrences x) -> In o (shape_occurrences x) -> shape_before x p o = true -> rank p < rank o.

(** For each occurrence there is an event that satisfies its predicate, a relevant one where only
    these count. *)
Definition servable (s : semantics) (x : shape) : Prop := forall o, In o (shape_occurrences x) ->
  exists e, satisfies (requirement x o) e = true /\ (projects s -> relevant e = true).

Lemma least : forall (rank : occurrence -> nat) l, l <> [] -> exists o, In o l /\ forall p, In p l -> rank o <= rank p.
Proof.
  induction l as [| a l IH]; [congruence |]. intros _. destruct l as [| b l].
  - exists a; simpl; split; auto. intros p [<- | []]; auto.
  - destruct IH as (o & I & M); [discriminate |]. destruct (le_lt_dec (rank a) (rank o)).
    + exists a; split; [simpl; auto |]. intros p [<- | J]; auto. apply M in J; lia.
    + exists o; split; [right; auto |]. intros p [<- | J]; auto; lia.
Qed.

(** Some occurrence is ready unless all are done. *)
Lemma some_ready : forall x done, acyclic x -> finished x done = false ->
  exists o, In o (shape_occurrences x) /\ ready x done o = true.
Proof.
  intros x done [rank R] F.
  destruct (least rank (filter (fun o => negb (among o done)) (shape_occurrences x))) as (o & I & M).
  { intros Q. rewrite <- not_true_iff_false in F. apply F. apply forallb_forall. intros o I.
    destruct (among o done) eqn:A; auto. exfalso.
    assert (J : In o (filter (fun o => negb (among o done)) (shape_occurrences x)))
      by (apply filter_In; rewrite A; auto).
    rewrite Q in J; destruct J. }
  apply filter_In in I as [I A]. exists o; split; auto. unfold ready. rewrite A; simpl. apply forallb_forall.
  intros p J. destruct (shape_before x p o) eqn:B; simpl; auto. destruct (among p done) eqn:D; auto. exfalso.
  assert (rank p < rank o) by auto. assert (rank o <= rank p); [| lia]. apply M, filter_In. rewrite D; auto.
Qed.

Lemma plain_extensible : forall s x, acyclic x -> servable s x -> Extensible relevant s (plain x).
Proof.
  intros s x A V u m I F. destruct (some_ready x (domain m) A F) as (o & O & R).
  destruct (V o O) as (e & S & T). exists e, ((o, e) :: m); split; auto. apply in_extend_plain.
  - apply states_sound in I as (pos & P & _); [apply (conditions_hold _ _ _ _ P) | apply plain_lawful].
  - exists o; auto.
Qed.

Theorem plain_text_verdict : forall s xs accepts, Forall acyclic xs -> Forall (servable s) xs ->
  (forall u, accepts u <-> Detected (fun e => relevant e = true) (Scenarios (map plain xs)) s u) ->
  forall u v, TextVerdict accepts u v <-> Verdict (fun e => relevant e = true) (Scenarios (map plain xs)) s u v.
Proof.
  intros s xs accepts A V. apply text_verdict; [apply all_lawful |]. apply Forall_forall. intros c I.
  apply in_map_iff in I as (x & <- & I). rewrite Forall_forall in A, V. apply plain_extensible; auto.
Qed.
End Plain.

(** The condition is needed: where no event serves an occurrence, a text that accepts no trace is right
    about detections, and says false where the definition says unknown. *)
Example servable_is_needed :
  let satisfies := fun p (_ : unit) => Nat.eqb p relevance in
  let x := Shape [(0, 0)] (fun _ _ => false) (fun _ => 1) in
  let detected := Detected (fun e => relevant satisfies e = true) (Scenarios [plain satisfies x]) Strict in
  TextVerdict detected [] Bottom /\
  Verdict (fun e => relevant satisfies e = true) (Scenarios [plain satisfies x]) Strict [] Unknown.
Proof.
  intros satisfies x detected. split.
  - intros u D. unfold detected in D.
    apply (detected_completes satisfies Strict [x]) in D as (y & v & w & [<- | []] & _ & _ & K).
    inversion K; subst; discriminate.
  - apply (verdict_correct (relevant satisfies) Strict [plain satisfies x] []). apply (all_lawful satisfies [x]).
Qed.
