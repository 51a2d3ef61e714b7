(** * What a monitor must know of a partial match

    The key of a partial match: which occurrences are done, the values of the variables that the
    future still asks for, and the times of the points that undecided guards ask for.  Of two partial
    matches with equal keys, either can do what the other one can. *)

Require Import List Bool Arith ZArith Lia Permutation.
Require Import RVAFT.Values RVAFT.Language RVAFT.Definition RVAFT.Search RVAFT.Conditions RVAFT.Pruning.
Import ListNotations.

Record key := Key {
  done : list occurrence;
  remembered : list (list value);        (* the values of the live variables, one list for each solution *)
  remembered_times : list (option Z) }.

Fixpoint equal_values (l m : list value) : bool :=
  match l, m with
  | [], [] => true
  | v :: l, w :: m => value_eqb v w && equal_values l m
  | _, _ => false
  end.

Lemma equal_values_iff : forall l m, equal_values l m = true <-> l = m.
Proof.
  induction l as [| v l IH]; destruct m as [| w m]; simpl; try (split; congruence).
  rewrite andb_true_iff, value_eqb_iff, IH. split; [intros [-> ->]; auto | intros H; injection H; auto].
Qed.

Definition equal_time (a b : option Z) : bool :=
  match a, b with None, None => true | Some x, Some y => Z.eqb x y | _, _ => false end.

Fixpoint equal_times (l m : list (option Z)) : bool :=
  match l, m with
  | [], [] => true
  | a :: l, b :: m => equal_time a b && equal_times l m
  | _, _ => false
  end.

Lemma equal_times_iff : forall l m, equal_times l m = true <-> l = m.
Proof.
  assert (E : forall a b, equal_time a b = true <-> a = b).
  { intros [a |] [b |]; simpl; try (split; congruence). rewrite Z.eqb_eq. split; congruence. }
  induction l as [| v l IH]; destruct m as [| w m]; simpl; try (split; congruence).
  rewrite andb_true_iff, E, IH. split; [intros [-> ->]; auto | intros H; injection H; auto].
Qed.

(** The key [k] is covered by [k']: the same occurrences and times, and every list of values of [k]
    is one of [k']. *)
Definition covered (k k' : key) : bool :=
  forallb (fun o => among o (done k')) (done k) && forallb (fun o => among o (done k)) (done k') &&
  forallb (fun l => existsb (equal_values l) (remembered k')) (remembered k) &&
  equal_times (remembered_times k) (remembered_times k').

Section Keys.
Variable t : tree.
Variable guards : list guard.
Variable part : nat -> list occurrence.
Variable os : list occurrence.
Variable before : occurrence -> occurrence -> bool.

Definition pattern_names (o : occurrence) : list nat :=
  match pattern_at t o with Some p => pattern_variables p | None => [] end.

(** The variables that a later event or an undecided guard asks for. *)
Definition asked_variables (m : assigned event) : list nat :=
  flat_map (fun o => if among o (domain m) then [] else pattern_names o) os ++
  flat_map (fun g => if known t part m g then [] else variables g) guards.

Definition live (m : assigned event) : list nat :=
  let bound := bound_variables t m in nodup Nat.eq_dec (filter (fun x => member x bound) (asked_variables m)).

Definition live_times (m : assigned event) : list occurrence :=
  flat_map (fun g => if known t part m g then [] else
    filter (fun o => among o (domain m)) (flat_map (asked_by part) (points g))) guards.

Definition key_of_match (m : assigned event) : key :=
  let names := live m in
  let asked := filter (known t part m) guards in
  Key (domain m)
    (map (fun bs => map (get Nat.eqb bs) names) (filter (solves part asked m) (unions t m)))
    (map (time_seen m) (live_times m)).

Definition may_serve (e : event) : list occurrence := filter (fun o => negb (is_nil (observed t o e))) os.

(** Consistency, with the guards only that concern an assignment. *)
Definition plan_here : plan event := Plan os before (consistent t guards part).

Variable r : resolution.
Hypothesis part_iff : forall n o, In o (part n) <-> InPart t r n o.

Lemma among_same : forall (m m' : assigned event) o, (forall o, In o (domain m) <-> In o (domain m')) ->
  among o (domain m) = among o (domain m').
Proof. intros m m' o D. apply eq_true_iff_eq. rewrite !among_iff. apply D. Qed.

Lemma bound_same : forall m m' x, (forall o, In o (domain m) <-> In o (domain m')) ->
  In x (bound_variables t m) -> In x (bound_variables t m').
Proof.
  intros m m' x D I. unfold bound_variables in *. apply in_flat_map in I as (o & I & J).
  apply in_flat_map. exists o; split; auto. now apply D.
Qed.

Lemma live_same : forall m m', (forall o, In o (domain m) <-> In o (domain m')) -> live m = live m'.
Proof.
  intros m m' D. unfold live. f_equal. unfold asked_variables.
  replace (flat_map (fun o => if among o (domain m') then [] else pattern_names o) os)
    with (flat_map (fun o => if among o (domain m) then [] else pattern_names o) os).
  2:{ rewrite !flat_map_concat_map. f_equal. apply map_ext. intros o. now rewrite (among_same m m' o D). }
  replace (flat_map (fun g => if known t part m' g then [] else variables g) guards)
    with (flat_map (fun g => if known t part m g then [] else variables g) guards).
  2:{ rewrite !flat_map_concat_map. f_equal. apply map_ext. intros g.
  now rewrite (known_same t part r part_iff m m' g D). }
  apply filter_ext. intros x. apply eq_true_iff_eq. rewrite !member_iff.
  split; apply bound_same; auto. intros o; symmetry; apply D.
Qed.

Lemma live_times_same : forall m m', (forall o, In o (domain m) <-> In o (domain m')) -> live_times m = live_times m'.
Proof.
  intros m m' D. unfold live_times. rewrite !flat_map_concat_map. f_equal. apply map_ext. intros g.
  rewrite (known_same t part r part_iff m m' g D). destruct (known t part m' g); auto.
  apply filter_ext. intros o. now apply among_same.
Qed.

Lemma seen_app : forall (x m : assigned event) o, seen (x ++ m) o = if among o (domain x) then seen x o else seen m o.
Proof.
  unfold seen; induction x as [| [p e] x IH]; simpl; intros m o; auto.
  unfold among in *; simpl. destruct (same o p); simpl; auto.
Qed.

Lemma domain_app_iff : forall (x m : assigned event) o, In o (domain (x ++ m)) <-> In o (domain x) \/ In o (domain m).
Proof. intros. rewrite domain_app, in_app_iff. tauto. Qed.

Theorem covered_le : forall m m', NoDup (domain m) -> NoDup (domain m') ->
  consistent t guards part m' = true ->
  covered (key_of_match m) (key_of_match m') = true -> Le plan_here m m'.
Proof.
  intros m m' N N' C' K. unfold covered in K. simpl in K. rewrite !andb_true_iff, !forallb_forall in K.
  destruct K as [[[D1 D2] V] T]. apply equal_times_iff in T.
  assert (D : forall o, In o (domain m) <-> In o (domain m')) by (intros o; split; intros I; apply among_iff; auto).
  clear D1 D2. constructor; auto. simpl. intros x NX IX CX.
  apply consistent_under in CX as [a CX].
  assert (NM : NoDup (domain (x ++ m'))).
  { rewrite domain_app in *. apply NoDup_app_iff in NX as (A & B & C). apply NoDup_app_iff. repeat split; auto.
    intros o I. rewrite <- D. auto. }
  assert (DX : forall o, In o (domain (x ++ m)) <-> In o (domain (x ++ m'))) by (intros o;
    rewrite !domain_app_iff, D; tauto).
  (* the solution of m in x ++ m, and one of m' with the same live values *)
  assert (CM : Under t guards part a m).
  { apply (under_part t guards part r part_iff a (x ++ m)); auto. intros y I; apply in_app_iff; auto. }
  apply under_iff in CM as (bs & Ibs & Rbs & Sbs).
  assert (X : exists bs', In bs' (unions t m') /\ solves part (filter (known t part m') guards) m' bs' = true /\
    map (get Nat.eqb bs) (live m) = map (get Nat.eqb bs') (live m')).
  { assert (I : In (map (get Nat.eqb bs) (live m))
        (map (fun bs => map (get Nat.eqb bs) (live m)) (filter (solves part (filter (known t part m) guards) m)
          (unions t m)))).
    { apply in_map_iff. exists bs; split; auto. apply filter_In; auto. }
    apply V, existsb_exists in I as (w & J & Q). apply equal_values_iff in Q.
    apply in_map_iff in J as (bs' & <- & J). apply filter_In in J as [J S]. exists bs'; auto. }
  destruct X as (bs' & Ibs' & Sbs' & LV). rewrite <- (live_same m m' D) in LV.
  assert (Rbs' : respects (get Nat.eqb bs') bs').
  { apply agree_respects. unfold solves in Sbs'. now apply andb_true_iff in Sbs' as [? _]. }
  assert (CM' : Under t guards part (get Nat.eqb bs') m') by (apply under_iff; exists bs'; auto).
  set (b := fun y => if member y (bound_variables t m') then get Nat.eqb bs' y else a y).
  (* a variable that is asked for has the value that it has under a *)
  assert (LIVE : forall y, In y (asked_variables m) -> b y = a y).
  { intros y I. unfold b. destruct (member y (bound_variables t m')) eqn:B; auto. apply member_iff in B.
    assert (BM : In y (bound_variables t m)) by (apply (bound_same m' m); auto; intros; symmetry; apply D).
    assert (L : In y (live m)).
    { apply nodup_In, filter_In. split; auto. now apply member_iff. }
    rewrite <- (respects_get Nat.eqb Nat.eqb_eq bs a y Rbs (unions_variables t m bs y Ibs BM)).
    clear - LV L. revert LV L. induction (live m) as [| z l IH]; simpl; intros LV L; [destruct L |].
    injection LV; intros LV' Q. destruct L as [-> | L]; auto. }
  assert (BOUND : forall y, In y (bound_variables t m') -> b y = get Nat.eqb bs' y).
  { intros y I. unfold b. now rewrite (proj2 (member_iff y (bound_variables t m')) I). }
  apply consistent_under. exists b. split.
  - intros o e I. destruct CX as [FX _], CM' as [FM _]. apply in_app_iff in I as [I | I].
    + destruct (FX o e) as (L & p & O & F); [apply in_app_iff; auto |]. split; auto. exists p; split; auto.
      apply (fits_pattern_same a); auto. intros y Y. symmetry. apply LIVE. unfold asked_variables.
      apply in_app_iff; left.
      assert (IO : In o (domain x)) by (apply in_domain; eauto).
      apply in_flat_map. exists o; split; [now apply IX |].
      replace (among o (domain m)) with false; [unfold pattern_names; now rewrite O |].
      symmetry; apply not_true_is_false. rewrite among_iff. rewrite domain_app in NX.
      apply NoDup_app_iff in NX as (_ & _ & NX). auto.
    + destruct (FM o e I) as (L & p & O & F). split; auto. exists p; split; auto.
      apply (fits_pattern_same (get Nat.eqb bs')); auto. intros y Y. symmetry; apply BOUND.
      unfold bound_variables. apply in_flat_map. exists o; split; [apply in_domain; eauto | now rewrite O].
  - intros g J KG. destruct (known t part m' g) eqn:KM.
    + destruct CM' as [_ GM]. rewrite <- (GM g J KM). apply holds_same.
      * intros y Y. apply BOUND. unfold known in KM. apply andb_true_iff in KM as [KM _].
        rewrite forallb_forall in KM. now apply member_iff, KM.
      * intros p P. apply time_at_same. intros o O. assert (I := known_asked t part m' g p o KM P O).
        unfold time_seen. rewrite seen_app. replace (among o (domain x)) with false; auto.
        symmetry; apply not_true_is_false. rewrite among_iff. intros Z. rewrite domain_app in NM.
        apply NoDup_app_iff in NM as (_ & _ & NM). now apply (NM o).
    + assert (KM0 : known t part m g = false) by (rewrite (known_same t part r part_iff m m' g D); auto).
      assert (KX : known t part (x ++ m) g = true) by (rewrite (known_same t part r part_iff (x ++ m) (x ++ m') g
        DX); auto).
      destruct CX as [_ GX]. rewrite <- (GX g J KX). apply holds_same.
      * intros y Y. apply LIVE. unfold asked_variables. apply in_app_iff; right. apply in_flat_map.
        exists g; split; auto. now rewrite KM0.
      * intros p P. apply time_at_same. intros o O. unfold time_seen at 1 2. rewrite !seen_app.
        destruct (among o (domain x)) eqn:AX; auto.
        assert (I : In o (domain m)).
        { assert (Z := known_asked t part (x ++ m) g p o KX P O). apply domain_app_iff in Z as [Z | Z]; auto.
          apply among_iff in Z; congruence. }
        assert (L : In o (live_times m)).
        { unfold live_times. apply in_flat_map. exists g; split; auto. rewrite KM0. apply filter_In.
          split; [apply in_flat_map; eauto | now apply among_iff]. }
        rewrite <- (live_times_same m m' D) in T.
        assert (E : time_seen m o = time_seen m' o).
        { clear - T L. revert T L. induction (live_times m) as [| z l IH]; simpl; intros T L; [destruct L |].
          injection T; intros T' Q. destruct L as [-> | L]; auto. }
        unfold time_seen in E. now rewrite E.
Qed.

Definition tracked_here : tracked event key := Tracked plan_here may_serve key_of_match.

Theorem tracked_sound : Sound covered tracked_here.
Proof.
  constructor; simpl.
  - apply (consistent_lawful t guards part r part_iff).
  - intros e o I. now apply filter_In in I.
  - intros e o m I C. apply filter_In; split; auto. apply consistent_under in C as (a & F & _).
    assert (X : fits_at t a o e) by (apply F; simpl; auto).
    apply (observed_iff t) in X as (bs & J & _). destruct (observed t o e); [destruct J | auto].
  - intros m m' N N' _ _ C K. now apply covered_le.
Qed.
End Keys.
