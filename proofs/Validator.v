(** * Certified texts have the verdict of the tree

    The certificates of [Hoa.v], [Progression.v] and [RmlCertificate.v] compare a text with plain
    scenarios.  Where these represent the scenarios of a tree, a certified text has the verdict that
    the definition gives for the tree. *)

Require Import List Bool Arith Lia.
Require Import RVAFT.Language RVAFT.Definition RVAFT.Search RVAFT.Plain RVAFT.Automaton RVAFT.Acceptance.
Require Import RVAFT.Exploration RVAFT.Hoa RVAFT.Ltlf RVAFT.Progression RVAFT.Rml RVAFT.RmlCertificate.
Require RVAFT.Scenarios RVAFT.Monitor.
Import ListNotations.

(** ** Plain scenarios that represent those of the definition *)

Section Representation.
Context {E : Type}.
Variable satisfies : nat -> E -> bool.
Notation plain := (plain satisfies).

(** The occurrences and the precedence are the same, and an assignment is consistent when each event
    satisfies the predicate of its occurrence. *)
Record Represents (x : shape) (c : scenario E) : Prop := {
  same_occurrences : forall o, In o (occurrences c) <-> In o (shape_occurrences x);
  same_precedence : forall p o, In p (shape_occurrences x) -> In o (shape_occurrences x) ->
    (before c p o <-> shape_before x p o = true);
  same_consistency : forall m, NoDup (domain m) -> incl (domain m) (shape_occurrences x) ->
    (consistent c m <-> forallb (fun y => satisfies (requirement x (fst y)) (snd y)) m = true);
  same_quiet : Scenarios.Quiet c }.

Lemma represented_partial : forall x c u position m, Represents x c ->
  (Partial c u position m <-> Partial (denoted (plain x)) u position m).
Proof.
  intros x c u position m [SO SP SC _]. split; intros [ON OF AT NT DC PK CH].
  - assert (I : incl (domain m) (shape_occurrences x)) by (intros o J; now apply SO, OF).
    constructor; simpl in *; auto.
    + intros o p J K B. apply (DC o p J); [now apply SO | apply SP; auto].
    + intros o p J K B. apply PK; auto. apply SP; auto.
    + apply SC; auto.
  - assert (I : incl (domain m) (shape_occurrences x)) by exact OF. simpl in *. constructor; auto.
    + intros o J. now apply SO, I.
    + intros o p J K B. apply SO in K. apply (DC o p J); auto. apply SP; auto.
    + intros o p J K B. apply PK; auto. apply SP; auto.
    + apply SC; auto.
Qed.

Lemma represented_complete : forall x c (m : assigned E), Represents x c ->
  (complete c m <-> complete (denoted (plain x)) m).
Proof. intros x c m [SO _ _ _]. unfold complete, incl; simpl. split; intros H o I; apply H; now apply SO. Qed.

(** Every scenario is represented, and every shape represents one. *)
Definition represented (scenarios : scenario E -> Prop) (xs : list shape) : Prop :=
  (forall c, scenarios c -> exists x, In x xs /\ Represents x c) /\
  (forall x, In x xs -> exists c, scenarios c /\ Represents x c).

Variable Rel : E -> Prop.
Hypothesis relevance_is : forall e, Rel e <-> relevant satisfies e = true.

Lemma relevant_positions : forall s u used,
  (match_positions Rel s u used <-> match_positions (fun e => relevant satisfies e = true) s u used) /\
  (partial_positions Rel s u used <-> partial_positions (fun e => relevant satisfies e = true) s u used).
Proof. intros. now apply Monitor.relevant_positions_same. Qed.

Lemma represented_detected : forall scenarios xs s u, represented scenarios xs ->
  (Detected Rel scenarios s u <-> Detected (fun e => relevant satisfies e = true) (Scenarios (map plain xs)) s u).
Proof.
  intros scenarios xs s u [C S]. split.
  - intros (w & v & c & -> & I & M). destruct (C c I) as (x & J & R).
    apply (Scenarios.quiet_match _ _ _ _ _ (same_quiet x c R)) in M as (pos & m & P & K & Q).
    exists w, v, (denoted (plain x)). split; [auto |]. split; [exists (plain x); split; auto; now apply in_map |].
    apply Scenarios.quiet_match; [apply Scenarios.denoted_quiet |].
    exists pos, m. rewrite <- (represented_partial x c), <- (represented_complete x c), <- (proj1 (relevant_positions _ _ _)); auto.
  - intros (w & v & c' & -> & (p & I & ->) & M). apply in_map_iff in I as (x & <- & I).
    apply (Scenarios.quiet_match _ _ _ _ _ (Scenarios.denoted_quiet _ _)) in M as (pos & m & P & K & Q).
    destruct (S x I) as (c & J & R). exists w, v, c. split; [auto |]. split; [auto |].
    apply Scenarios.quiet_match; [apply (same_quiet x c R) |]. exists pos, m.
    rewrite (represented_partial x c), (represented_complete x c), (proj1 (relevant_positions _ _ _)); auto.
Qed.

Lemma represented_left : forall scenarios xs s u, represented scenarios xs ->
  (Left Rel scenarios s u <-> Left (fun e => relevant satisfies e = true) (Scenarios (map plain xs)) s u).
Proof.
  intros scenarios xs s u [C S]. split.
  - intros (c & I & M). destruct (C c I) as (x & J & R).
    apply (Scenarios.quiet_left _ _ _ _ _ (same_quiet x c R)) in M as (pos & m & P & K & Q).
    exists (denoted (plain x)). split; [exists (plain x); split; auto; now apply in_map |].
    apply Scenarios.quiet_left; [apply Scenarios.denoted_quiet |]. exists pos, m.
    rewrite <- (represented_partial x c), <- (represented_complete x c), <- (proj2 (relevant_positions _ _ _)); auto.
  - intros (c' & (p & I & ->) & M). apply in_map_iff in I as (x & <- & I).
    apply (Scenarios.quiet_left _ _ _ _ _ (Scenarios.denoted_quiet _ _)) in M as (pos & m & P & K & Q).
    destruct (S x I) as (c & J & R). exists c. split; auto. apply Scenarios.quiet_left; [apply (same_quiet x c R) |].
    exists pos, m.
    rewrite (represented_partial x c), (represented_complete x c), (proj2 (relevant_positions _ _ _)); auto.
Qed.

(** Scenarios have the verdicts of the plain scenarios that represent them. *)
Theorem represented_verdict : forall scenarios xs s u v, represented scenarios xs ->
  (Verdict Rel scenarios s u v <-> Verdict (fun e => relevant satisfies e = true) (Scenarios (map plain xs)) s u v).
Proof.
  intros scenarios xs s u v R. pose proof (represented_detected scenarios xs s u R) as D.
  pose proof (represented_left scenarios xs s u R) as L. destruct v; simpl; tauto.
Qed.

End Representation.

(** ** Trees *)

Lemma represented_acyclic : forall satisfies t w x c, IsScenario t w [] c -> Represents satisfies x c -> acyclic x.
Proof.
  intros satisfies t w x c (r & last & _ & _ & _ & ([rank F] & _) & O & B & _) [SO SP _ _].
  exists rank. intros p o I J K. apply SP in K; auto. apply SO, O in I. apply SO, O in J. apply F; auto.
  specialize (B p o). tauto.
Qed.

Section Trees.
Variable t : tree.
Variable w : selection.
Variable satisfies : nat -> event -> bool.
Variable xs : list shape.
Hypothesis relevance_is : forall e, RelevantEvent t e <-> relevant satisfies e = true.
Hypothesis tree_represented : represented satisfies (IsScenario t w []) xs.

Lemma tree_verdict : forall s u v, VerdictOfTree t w s u v <->
  Verdict (fun e => relevant satisfies e = true) (Scenarios (map (plain satisfies) xs)) s u v.
Proof. intros; now apply represented_verdict. Qed.

Lemma tree_acyclic : Forall acyclic xs.
Proof.
  apply Forall_forall. intros x I. apply tree_represented in I as (c & S & R).
  now apply (represented_acyclic satisfies t w x c).
Qed.

Variable predicates : list nat.
Variable possible : list letter.
Hypothesis letters_possible : forall e, In (letter_of satisfies predicates e) possible.

(** A certified text of RML has the verdict of the tree on every trace. *)
Theorem certified_rml : forall mix s fuel depth equations x,
  certify_rml mix s xs predicates possible fuel depth equations x = Certified ->
  forall u v, RmlVerdict equations x (valuations satisfies u) v <-> VerdictOfTree t w s u v.
Proof. intros. rewrite tree_verdict. eapply certify_rml_verdict; eauto. Qed.
End Trees.
