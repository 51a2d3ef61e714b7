(** * Lost, doubled and added events under [scattered]

    A match of [scattered] may leave out any event, and its conditions look at nothing but its own
    events.  So an added event keeps every detection, and a lost event forges none.  With [late] this
    holds for an event that does not move the greatest time forward, such as a doubled one. *)

Require Import List Bool Arith ZArith Lia.
Require Import RVAFT.Values RVAFT.Language RVAFT.Definition RVAFT.Search RVAFT.Conditions RVAFT.Scenarios.
Import ListNotations.

(** The positions of a sublist in the longer list. *)
Lemma sublist_positions : forall A (u v : list A), Sublist u v ->
  exists f : nat -> nat, (forall i j, i < j -> f i < f j) /\
    (forall i e, nth_error u i = Some e -> nth_error v (f i) = Some e).
Proof.
  induction 1 as [| x l m B (f & U & N) | x l m B (f & U & N)].
  - exists (fun i => i). split; auto.
  - exists (fun i => match i with 0 => 0 | S i => S (f i) end). split.
    + intros [| i] [| j] L; try lia. assert (f i < f j) by (apply U; lia). lia.
    + intros [| i] e; simpl; auto.
  - exists (fun i => S (f i)). split; [| auto]. intros i j L. specialize (U i j L). lia.
Qed.

Lemma sublist_refl : forall A (l : list A), Sublist l l.
Proof. induction l; constructor; auto. Qed.

Lemma sublist_without : forall A n (l : list A), Sublist (firstn n l ++ skipn (S n) l) l.
Proof.
  induction n; destruct l; simpl; constructor; [apply sublist_refl | apply IHn].
Qed.

Lemma sublist_prefix : forall A (prefix rest v : list A), Sublist (prefix ++ rest) v -> Sublist prefix v.
Proof.
  intros A prefix rest v S. remember (prefix ++ rest) as u eqn:Q. revert prefix rest Q.
  induction S as [| x l m S IH | x l m S IH]; intros prefix rest Q.
  - destruct prefix; [constructor | discriminate].
  - destruct prefix as [| y prefix].
    + clear. apply (sublist_skip x). induction m; constructor; auto.
    + injection Q as -> ->. constructor. now apply (IH _ rest).
  - constructor. now apply (IH _ rest).
Qed.

(** ** Any events *)

Section Scenarios.
Context {E : Type}.
Variable Relevant : E -> Prop.

Lemma match_in_longer : forall c (u v : list E), Quiet c -> Sublist u v ->
  Match Relevant Scattered c u -> Match Relevant Scattered c v.
Proof.
  intros c u v Q S (position & m & P & C & _). destruct (sublist_positions E u v S) as (f & U & N).
  exists (fun o => f (position o)), m. split; [| split; [assumption | split; [exact I |]]].
  2:{ apply Q; [apply (once _ _ _ _ P) | apply (of_scenario _ _ _ _ P) | apply (conditions_hold _ _ _ _ P)]. }
  destruct P as [P1 P2 P3 P4 P5 P6 P7]. constructor; auto.
  intros o p O O' R. apply P4; auto.
  destruct (Nat.lt_trichotomy (position o) (position p)) as [L | [L | L]]; auto; apply U in L; lia.
Qed.

(** A trace with more events, in the same order, keeps each detection. *)
Theorem detected_in_longer : forall (Scenarios : scenario E -> Prop) (u v : list E),
  (forall c, Scenarios c -> Quiet c) -> Sublist u v ->
  Detected Relevant Scenarios Scattered u -> Detected Relevant Scenarios Scattered v.
Proof.
  intros Scenarios u v Q S (prefix & rest & c & -> & I & M). exists v, [], c.
  rewrite app_nil_r. repeat split; auto. apply (match_in_longer c prefix); auto. now apply (sublist_prefix _ _ rest).
Qed.
End Scenarios.

(** ** The verdict of a tree on a log *)

(** An event with this time moves the greatest time of the events before it forward. *)
Definition moves_forward (before : list (value * option Z)) (time : option Z) : Prop :=
  exists z, time = Some z /\ forall v z', In (v, Some z') before -> (z' < z)%Z.

Lemma late_before : forall d a b i, i < length a -> (LateAt d (a ++ b) i <-> LateAt d a i).
Proof.
  intros d a b i L. unfold LateAt.
  split; intros (v & z & j & w & z' & I & J & K & D); exists v, z, j, w, z'.
  - rewrite nth_error_app1 in I, K by lia. auto.
  - rewrite !nth_error_app1 by lia. auto.
Qed.

Lemma late_after : forall d a e b i, length a <= i -> ~ moves_forward a (snd e) ->
  (LateAt d (a ++ e :: b) (S i) <-> LateAt d (a ++ b) i).
Proof.
  intros d a [x t] b i L M. simpl in M. unfold LateAt.
  assert (AT : forall j, length a <= j -> nth_error (a ++ (x, t) :: b) (S j) = nth_error (a ++ b) j).
  { intros j J. rewrite !nth_error_app2 by lia. now replace (S j - length a) with (S (j - length a)) by lia. }
  split; intros (v & z & j & w & z' & I & J & K & D).
  - rewrite AT in I by lia. destruct (lt_eq_lt_dec j (length a)) as [[G | G] | G].
    + exists v, z, j, w, z'. rewrite nth_error_app1 in K by lia. rewrite (nth_error_app1 _ _ G).
      repeat split; auto; lia.
    + subst j. rewrite nth_error_app2, Nat.sub_diag in K by lia. injection K as <- ->.
      (* some event before it has a time that is at least as great *)
      assert (X : exists j w z'', nth_error a j = Some (w, Some z'') /\ (z' <= z'')%Z).
      { clear - M. revert M. induction a as [| [w [y |]] a IH]; intros M.
        - destruct M. exists z'. split; auto. intros ? ? [].
        - destruct (Z_le_gt_dec z' y) as [G | G]; [exists 0, w, y; auto |].
          destruct IH as (j & w' & z'' & K & G').
          + intros (q & Q & H). apply M. exists q. split; auto. intros v0 y0 [X | X]; [| eauto].
            injection X as -> ->. injection Q as ->. lia.
          + exists (S j), w', z''. auto.
        - destruct IH as (j & w' & z'' & K & G').
          + intros (q & Q & H). apply M. exists q. split; auto. intros v0 y0 [X | X]; [discriminate | eauto].
          + exists (S j), w', z''. auto. }
      destruct X as (j & w' & z'' & K & G). exists v, z, j, w', z''.
      assert (R : j < length a) by (apply nth_error_Some; congruence).
      rewrite (nth_error_app1 _ _ R). repeat split; auto; lia.
    + destruct j as [| j]; [lia |]. rewrite (AT j) in K by lia. exists v, z, j, w, z'. repeat split; auto; lia.
  - rewrite <- AT in I by lia. destruct (le_lt_dec (length a) j) as [G | G].
    + exists v, z, (S j), w, z'. rewrite (AT j) by lia. repeat split; auto; lia.
    + exists v, z, j, w, z'. rewrite nth_error_app1 in K by lia. rewrite (nth_error_app1 _ _ G).
      repeat split; auto; lia.
Qed.

Lemma same_event : forall e e', content e = content e' -> time_of e = time_of e' ->
  (late e = true <-> late e' = true) -> e = e'.
Proof.
  intros [c t l] [c' t' l']; simpl; intros -> -> L. f_equal. now apply eq_true_iff_eq.
Qed.

Lemma equal_places : forall A (u v : list A), length u = length v ->
  (forall i x y, nth_error u i = Some x -> nth_error v i = Some y -> x = y) -> u = v.
Proof.
  induction u as [| x u IH]; destruct v as [| y v]; simpl; intros L Q; try discriminate; auto.
  f_equal; [apply (Q 0); auto | apply IH; [lia |]]. intros i. apply (Q (S i)).
Qed.

(** The trace of a log with an added event, without that event, is the trace of the log. *)
Lemma trace_with_added : forall t a e b trace trace',
  lateness t = None \/ ~ moves_forward a (snd e) ->
  TraceOf t (a ++ b) trace -> TraceOf t (a ++ e :: b) trace' -> Sublist trace trace'.
Proof.
  intros t a e b trace trace' M [L T] [L' T']. rewrite app_length in L. rewrite app_length in L'. simpl in L'.
  assert (SAME : forall i j x y, nth_error trace i = Some x -> nth_error trace' j = Some y ->
    (i < length a /\ j = i \/ length a <= i /\ j = S i) -> x = y).
  { intros i j x y X Y W. destruct (T i x X) as [H F]. destruct (T' j y Y) as [H' F'].
    assert (Q : nth_error (a ++ b) i = nth_error (a ++ e :: b) j).
    { destruct W as [[G ->] | [G ->]]; [now rewrite !nth_error_app1 by lia |].
      rewrite !nth_error_app2 by lia. now replace (S i - length a) with (S (i - length a)) by lia. }
    rewrite Q, H' in H. injection H as C Z. apply same_event; auto.
    rewrite F, F'. split; intros (d & D & LA); exists d; split; auto; destruct M as [M | M]; try congruence;
      destruct W as [[G ->] | [G ->]].
    - rewrite late_before in * by lia. exact LA.
    - now apply (late_after d a e b i G M).
    - rewrite late_before in * by lia. exact LA.
    - now apply (late_after d a e b i G M) in LA. }
  assert (H : trace = firstn (length a) trace' ++ skipn (S (length a)) trace').
  { apply equal_places.
    - rewrite app_length, firstn_length, skipn_length. lia.
    - intros i x y X Y. destruct (le_lt_dec (length a) i) as [G | G].
      + rewrite nth_error_app2 in Y by (rewrite firstn_length; lia). rewrite firstn_length in Y.
        apply (SAME i (S i)); auto. rewrite <- Y, <- (firstn_skipn (S (length a)) trace') at 1.
        rewrite nth_error_app2 by (rewrite firstn_length; lia). rewrite firstn_length. f_equal. lia.
      + rewrite nth_error_app1 in Y by (rewrite firstn_length; lia).
        apply (SAME i i); auto. rewrite <- Y, <- (firstn_skipn (length a) trace') at 1.
        rewrite nth_error_app1; auto. rewrite firstn_length; lia. }
  rewrite H. apply sublist_without.
Qed.

(** In a tree without absent events, an event that is added anywhere keeps each detection: without
    [late], or where it does not move the greatest time forward. *)
Theorem added_hides_nothing : forall t w a e b trace trace', no_absences t = true ->
  lateness t = None \/ ~ moves_forward a (snd e) ->
  TraceOf t (a ++ b) trace -> TraceOf t (a ++ e :: b) trace' ->
  VerdictOfTree t w Scattered trace Top -> VerdictOfTree t w Scattered trace' Top.
Proof.
  intros t w a e b trace trace' NA M T T'. apply detected_in_longer; [| eapply trace_with_added; eauto].
  intros c. now apply scenario_quiet.
Qed.

(** The loss of such an event forges no detection. *)
Theorem lost_forges_nothing : forall t w a e b trace trace', no_absences t = true ->
  lateness t = None \/ ~ moves_forward a (snd e) ->
  TraceOf t (a ++ b) trace -> TraceOf t (a ++ e :: b) trace' ->
  ~ VerdictOfTree t w Scattered trace' Top -> ~ VerdictOfTree t w Scattered trace Top.
Proof.
  intros t w a e b trace trace' NA M T T' N D. exact (N (added_hides_nothing t w a e b trace trace' NA M T T' D)).
Qed.

(** A doubled event keeps each detection, also with [late]. *)
Theorem doubled_hides_nothing : forall t w a e b trace trace', no_absences t = true ->
  TraceOf t (a ++ e :: b) trace -> TraceOf t (a ++ e :: e :: b) trace' ->
  VerdictOfTree t w Scattered trace Top -> VerdictOfTree t w Scattered trace' Top.
Proof.
  intros t w a e b trace trace' NA T T'.
  change (a ++ e :: b) with (a ++ [e] ++ b) in T. change (a ++ e :: e :: b) with (a ++ [e] ++ e :: b) in T'.
  rewrite app_assoc in T, T'. apply (added_hides_nothing t w (a ++ [e]) e b); auto. right.
  intros (z & Q & H). assert (X : (z < z)%Z); [| lia]. destruct e as [v s]. simpl in Q. subst s.
  apply (H v). apply in_app_iff. right. now left.
Qed.
