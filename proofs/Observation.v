(** Observational determinism of a machine with output: the criterion that `papers/multipath` uses.

    An observer sees the letters of a word that are not hidden. The output is a function of what is
    seen if and only if each hidden letter leads from each reachable state to an equivalent one; in a
    minimal machine, to the state itself. *)

Require Import List Bool.
Import ListNotations.

Section Machine.

Variables letter state output : Type.
Variable step : state -> letter -> state.
Variable out : state -> output.
Variable start : state.
Variable hidden : letter -> bool.

Definition run (q : state) (w : list letter) : state := fold_left step w q.

(** What an observer sees of a word. *)
Definition seen (w : list letter) : list letter := filter (fun a => negb (hidden a)) w.

Definition deterministic : Prop :=
  forall w w', seen w = seen w' -> out (run start w) = out (run start w').

Definition equivalent (p q : state) : Prop :=
  forall w, out (run p w) = out (run q w).

Definition stays : Prop :=
  forall w a, hidden a = true -> equivalent (run start w) (step (run start w) a).

Lemma run_app : forall q w w', run q (w ++ w') = run (run q w) w'.
Proof. intros; apply fold_left_app. Qed.

Lemma seen_app : forall w w', seen (w ++ w') = seen w ++ seen w'.
Proof. intros; apply filter_app. Qed.

Lemma equivalent_step : forall p q a, equivalent p q -> equivalent (step p a) (step q a).
Proof. intros p q a same w; exact (same (a :: w)). Qed.

Lemma seen_last : forall w a, seen (w ++ [a]) = if hidden a then seen w else seen w ++ [a].
Proof.
  intros; rewrite seen_app; unfold seen at 2; simpl.
  destruct (hidden a); simpl; [apply app_nil_r|reflexivity].
Qed.

Lemma stays_seen : stays -> forall w, equivalent (run start w) (run start (seen w)).
Proof.
  intros same w; induction w as [|a w IH] using rev_ind; [intro; reflexivity|].
  rewrite seen_last, run_app; simpl.
  destruct (hidden a) eqn:unseen.
  - intro v. rewrite <- (IH v). symmetry. exact (same w a unseen v).
  - rewrite run_app; simpl. apply equivalent_step, IH.
Qed.

Theorem deterministic_iff : deterministic <-> stays.
Proof.
  split.
  - intros same w a unseen v.
    change (out (run (run start w) v) = out (run (run start w) (a :: v))).
    rewrite <- !run_app. apply same.
    rewrite !seen_app. f_equal. unfold seen; simpl. now rewrite unseen.
  - intros same w w' equal.
    pose proof (stays_seen same w []) as one. pose proof (stays_seen same w' []) as other.
    simpl in one, other. rewrite one, other, equal. reflexivity.
Qed.

(** In a minimal machine, equivalent states are equal. *)
Corollary minimal_iff :
  (forall p q, equivalent p q -> p = q) ->
  (deterministic <-> forall w a, hidden a = true -> step (run start w) a = run start w).
Proof.
  intro minimal. rewrite deterministic_iff. split.
  - intros same w a unseen. symmetry. apply minimal, same, unseen.
  - intros loops w a unseen v. now rewrite loops.
Qed.

End Machine.
