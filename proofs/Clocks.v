(** * Time points as variables

    A text names the time of an event by a variable.  In a scenario, [at(n)] is then the variable of the
    occurrence, and [start(n)] and [end(n)] are the least and the greatest of several.  An undefined time
    is null, so a time point may stand only where null is undefined. *)

Require Import List Bool Arith ZArith Lia.
Require Import RVAFT.Values RVAFT.Language RVAFT.Definition RVAFT.Search RVAFT.Conditions RVAFT.Scenarios.
Require Import RVAFT.Monitor RVAFT.Slices.
Import ListNotations.

Section Clock.
Variable clock : occurrence -> nat.
Variable part : nat -> list occurrence.

Definition extreme_of (o : operator) (l : list occurrence) : guard :=
  match l with [x] => ValueOf (clock x) | _ => Apply o (map (fun x => ValueOf (clock x)) l) end.

Definition clocked_point (p : point) : guard :=
  match p with
  | At n => ValueOf (clock (n, 0))
  | Start n => extreme_of Minimum (part n)
  | End n => extreme_of Maximum (part n)
  end.

Fixpoint clocked (g : guard) : guard :=
  match g with
  | TimeOf p => clocked_point p
  | Constant _ | ValueOf _ => g
  | Apply o l => Apply o (map clocked l)
  | AndThen l r => AndThen (clocked l) (clocked r)
  | OrElse l r => OrElse (clocked l) (clocked r)
  end.

(** Operators under which null is undefined. *)
Definition strict (o : operator) : bool :=
  match o with
  | Less | LessOrEqual | Greater | GreaterOrEqual | Add | Subtract | Minimum | Maximum => true
  | _ => false
  end.

Definition is_point (g : guard) : bool := match g with TimeOf _ => true | _ => false end.

(** Time points stand only below such operators. *)
Fixpoint timely (g : guard) : bool :=
  match g with
  | TimeOf _ => false
  | Constant _ | ValueOf _ => true
  | Apply o l => forallb (fun h => timely h || (is_point h && strict o)) l
  | AndThen l r | OrElse l r => timely l && timely r
  end.

Lemma extreme_null : forall choose l best, In Null l -> extreme choose best l = None.
Proof.
  intros choose; induction l as [| v l IH]; intros best []; simpl; [now subst |]. destruct v; auto.
Qed.

Lemma strict_null : forall o l, strict o = true -> In Null l -> apply o l = None.
Proof.
  intros o l S I. unfold apply. destruct (forallb defined l); auto. simpl.
  destruct o; try discriminate.
  1-6: destruct l as [| v [| w [| x l]]]; auto;
    destruct I as [-> | [-> | []]]; simpl; unfold ordered, numeric; auto; destruct v; auto.
  all: destruct l as [| v l]; [destruct I |]; destruct v; auto; destruct I as [I | I]; try discriminate;
    now apply extreme_null.
Qed.

(** What a guard says of a time: it, or that it is undefined. *)
Definition tells (found : option value) (time : option Z) : Prop :=
  match time with Some z => found = Some (integer z) | None => found = None \/ found = Some Null end.

Lemma all_defined_none : forall A (l : list (option A)), In None l -> all_defined l = None.
Proof.
  induction l as [| [x |] l IH]; simpl; intros H; [destruct H | destruct H; [discriminate | now rewrite IH] | auto].
Qed.

Lemma all_defined_in : forall A (l : list (option A)) r v, all_defined l = Some r -> In (Some v) l -> In v r.
Proof.
  intros A l r v H I. apply all_defined_iff in H. subst. apply in_map_iff in I as (w & Q & I). now injection Q as ->.
Qed.

Lemma eval_clocked : forall a time g, timely g = true ->
  (forall p, In p (points g) -> tells (eval a no_time (clocked_point p)) (time p)) ->
  eval a no_time (clocked g) = eval a time g.
Proof.
  intros a time; induction g as [v | x | p | o l IH | l r IHl IHr | l r IHl IHr] using guard_induction;
    intros T P; simpl in T; try discriminate; auto.
  - simpl. rewrite map_map. rewrite forallb_forall in T. rewrite Forall_forall in IH.
    assert (E : forall h, In h l -> eval a no_time (clocked h) = eval a time h \/
      (strict o = true /\ eval a time h = None /\
        (eval a no_time (clocked h) = None \/ eval a no_time (clocked h) = Some Null))).
    { intros h I. specialize (T h I). apply orb_true_iff in T as [T | T].
      - left. apply IH; auto. intros p J. apply P. simpl. apply in_flat_map; eauto.
      - apply andb_true_iff in T as [Q S]. destruct h as [| | p | | |]; try discriminate.
        assert (K : tells (eval a no_time (clocked_point p)) (time p)).
        { apply P. simpl. apply in_flat_map. exists (TimeOf p); simpl; auto. }
        simpl. unfold tells in K. destruct (time p) as [z |]; simpl; [left; exact K | right; auto]. }
    clear IH T P.
    assert (C : (forall h, In h l -> eval a no_time (clocked h) = eval a time h) \/
      exists h, In h l /\ strict o = true /\ eval a time h = None /\
        (eval a no_time (clocked h) = None \/ eval a no_time (clocked h) = Some Null)).
    { induction l as [| h l IHl]; [left; intros h [] |]. destruct (E h (or_introl eq_refl)) as [Q | Q].
      - destruct IHl as [R | (k & I & R)]; [intros; apply E; simpl; auto | |].
        + left. intros k [<- | I]; auto.
        + right. exists k; simpl; auto.
      - right. exists h; simpl; auto. }
    destruct C as [C | (h & I & S & N & M)]; [now rewrite (map_ext_in _ (eval a time) l) |].
    rewrite (all_defined_none _ (map (eval a time) l)) by (apply in_map_iff; eauto).
    destruct (all_defined (map (fun h => eval a no_time (clocked h)) l)) as [vs |] eqn:A; auto.
    destruct M as [M | M].
    + rewrite all_defined_none in A; [discriminate |]. apply in_map_iff; eauto.
    + apply strict_null; auto. eapply all_defined_in; [exact A |]. apply in_map_iff; eauto.
  - apply andb_true_iff in T as [T T']. simpl.
    rewrite IHl, IHr; auto; intros p I; apply P; simpl; apply in_app_iff; auto.
  - apply andb_true_iff in T as [T T']. simpl.
    rewrite IHl, IHr; auto; intros p I; apply P; simpl; apply in_app_iff; auto.
Qed.

Lemma choose_integers : forall (choose : number -> number -> number) (best : Z -> Z -> Z),
  (forall x y, choose (Number x 0) (Number y 0) = Number (best x y) 0) ->
  forall l z, extreme choose (Number z 0) (map integer l) = Some (integer (fold_left best l z)).
Proof. intros choose best H; induction l as [| y l IH]; intros z; simpl; auto. rewrite H. apply IH. Qed.

Lemma smaller_integer : forall x y, smaller (Number x 0) (Number y 0) = Number (Z.min x y) 0.
Proof.
  intros x y. unfold smaller, compare_numbers; simpl. rewrite !Z.mul_1_r.
  destruct (Z.compare_spec y x); f_equal; lia.
Qed.

Lemma greater_integer : forall x y, greater (Number x 0) (Number y 0) = Number (Z.max x y) 0.
Proof.
  intros x y. unfold greater, compare_numbers; simpl. rewrite !Z.mul_1_r.
  destruct (Z.compare_spec y x); f_equal; lia.
Qed.

(** The variables of a scenario tell its time points, when they are the times of the events. *)
Lemma point_told : forall a (m : assigned event) p, NoDup (domain m) -> asked_by part p <> [] ->
  (forall o, In o (asked_by part p) -> exists e, In (o, e) m /\ a (clock o) = time_value e) ->
  tells (eval a no_time (clocked_point p)) (time_at part m p).
Proof.
  intros a m p N NE H.
  assert (ONE : forall o, In o (asked_by part p) -> tells (Some (a (clock o))) (time_seen m o)).
  { intros o I. destruct (H o I) as (e & J & Q). unfold time_seen. apply (seen_iff _ m o e N) in J. rewrite J, Q.
    unfold time_value. destruct (time_of e); simpl; auto. }
  assert (X : forall o choose best l, (o = Minimum /\ choose = smaller \/ o = Maximum /\ choose = greater) ->
    (forall x y, choose (Number x 0) (Number y 0) = Number (best x y) 0) ->
    l <> [] -> (forall x, In x l -> tells (Some (a (clock x))) (time_seen m x)) ->
    tells (eval a no_time (extreme_of o l)) (extreme_time best m l)).
  { clear NE H ONE p. intros o choose best l O C NE T. destruct l as [| x [| y l]]; [congruence | |].
    - specialize (T x (or_introl eq_refl)). unfold extreme_time. simpl.
      destruct (time_seen m x); simpl; auto.
    - change (extreme_of o (x :: y :: l)) with (Apply o (map (fun z => ValueOf (clock z)) (x :: y :: l))).
      generalize dependent (x :: y :: l). clear x y l. intros l NE T.
      assert (V : eval a no_time (Apply o (map (fun z => ValueOf (clock z)) l)) = apply o (map (fun z => a (clock
        z)) l)).
      { simpl. rewrite map_map. simpl. replace (map (fun z => Some (a (clock z))) l)
          with (map Some (map (fun z => a (clock z)) l)) by apply map_map.
        now rewrite (proj2 (all_defined_iff _ _ _) eq_refl). }
      rewrite V. clear V.
      unfold extreme_time. destruct (all_defined (map (time_seen m) l)) as [ts |] eqn:A.
      + apply all_defined_iff in A.
        assert (V : map (fun x0 => a (clock x0)) l = map integer ts).
        { clear NE. revert ts A. induction l as [| z k IH]; intros [| w ts] A; try discriminate; auto.
          simpl in A. injection A as A B. simpl. f_equal; [| apply IH; auto; intros; apply T; simpl; auto].
          specialize (T z (or_introl eq_refl)). rewrite A in T. simpl in T. congruence. }
        rewrite V. destruct ts as [| z ts]; [destruct l; [congruence | discriminate] |]. unfold apply.
        replace (forallb defined (map integer (z :: ts))) with true
          by (symmetry; apply forallb_forall; intros v I; apply in_map_iff in I as (w & <- & _); reflexivity).
        simpl. destruct O as [[-> ->] | [-> ->]]; now apply choose_integers.
      + simpl. left. apply strict_null; [destruct O as [[-> _] | [-> _]]; auto |].
        assert (E : exists z, In z l /\ time_seen m z = None).
        { clear NE T. induction l as [| z k IH]; [discriminate |]. simpl in A.
          destruct (time_seen m z) eqn:Q; [| exists z; simpl; auto].
          destruct IH as (w & I & R); [destruct (all_defined (map (time_seen m) k)); [discriminate | auto] |].
          exists w; simpl; auto. }
        destruct E as (z & I & Q). specialize (T z I). rewrite Q in T. simpl in T.
          destruct T as [T | T]; [discriminate |].
        apply in_map_iff. exists z; split; auto. congruence. }
  destruct p as [n | n | n]; simpl in *.
  - apply ONE; auto.
  - apply (X Minimum smaller Z.min); auto using smaller_integer.
  - apply (X Maximum greater Z.max); auto using greater_integer.
Qed.

(** ** Variables of clocked guards *)

Lemma clocked_point_variables : forall p x, In x (variables (clocked_point p)) <->
  exists o, In o (asked_by part p) /\ x = clock o.
Proof.
  assert (X : forall op l x, In x (variables (extreme_of op l)) <-> exists o, In o l /\ x = clock o).
  { intros op l x. assert (G : In x (flat_map variables (map (fun y => ValueOf (clock y)) l)) <->
      exists o, In o l /\ x = clock o).
    { rewrite in_flat_map. split.
      - intros (g & I & J). apply in_map_iff in I as (o & <- & I). destruct J as [<- | []]. exists o; auto.
      - intros (o & I & ->). exists (ValueOf (clock o)). split; [apply in_map_iff; eauto | simpl; auto]. }
    destruct l as [| y [| z l]]; exact G. }
  intros [n | n | n] x; simpl; auto. split.
  - intros [<- | []]. exists (n, 0); auto.
  - intros (o & [<- | []] & ->). auto.
Qed.

Lemma clocked_variables : forall g x, In x (variables (clocked g)) <->
  In x (variables g) \/ exists p o, In p (points g) /\ In o (asked_by part p) /\ x = clock o.
Proof.
  induction g as [v | y | p | o l IH | l r IHl IHr | l r IHl IHr] using guard_induction; intros x.
  - simpl. split; [tauto |]. intros [[] | (p & o & [] & _)].
  - simpl. split; [tauto |]. intros [H | (p & o & [] & _)]; auto.
  - simpl clocked. rewrite clocked_point_variables. simpl. split.
    + intros (o & I & ->). right. exists p, o; auto.
    + intros [[] | (q & o & [<- | []] & I & ->)]. eauto.
  - simpl. rewrite flat_map_concat_map, map_map, <- flat_map_concat_map, !in_flat_map. rewrite Forall_forall in IH.
    split.
    + intros (g & I & J). apply IH in J as [J | (p & q & J & K & ->)]; auto; [left; eauto |].
      right. exists p, q. repeat split; auto. apply in_flat_map; eauto.
    + intros [(g & I & J) | (p & q & I & J & ->)].
      * exists g; split; auto. apply IH; auto.
      * apply in_flat_map in I as (g & I & K). exists g; split; auto. apply IH; eauto 8.
  - simpl. rewrite !in_app_iff, IHl, IHr. split.
    + intros [[H | (p & q & J & K & ->)] | [H | (p & q & J & K & ->)]]; auto;
        right; exists p, q; rewrite in_app_iff; auto.
    + intros [[H | H] | (p & q & J & K & ->)]; auto. apply in_app_iff in J as [J | J]; [left | right]; eauto 8.
  - simpl. rewrite !in_app_iff, IHl, IHr. split.
    + intros [[H | (p & q & J & K & ->)] | [H | (p & q & J & K & ->)]]; auto;
        right; exists p, q; rewrite in_app_iff; auto.
    + intros [[H | H] | (p & q & J & K & ->)]; auto. apply in_app_iff in J as [J | J]; [left | right]; eauto 8.
Qed.

Lemma clocked_point_points : forall p, points (clocked_point p) = [].
Proof.
  assert (X : forall op l, points (extreme_of op l) = []).
  { intros op l. assert (G : flat_map points (map (fun y => ValueOf (clock y)) l) = []).
    { induction l; simpl; auto. }
    destruct l as [| y [| z l]]; auto. }
  intros [n | n | n]; simpl; auto.
Qed.

Lemma clocked_points : forall g, points (clocked g) = [].
Proof.
  induction g as [v | y | p | o l IH | l r IHl IHr | l r IHl IHr] using guard_induction; simpl; auto.
  - apply clocked_point_points.
  - induction IH as [| g l Q _ IH]; simpl; auto. now rewrite Q.
  - now rewrite IHl, IHr.
  - now rewrite IHl, IHr.
Qed.

(** Without time points a guard is left as it is. *)
Lemma clocked_untimed : forall g, points g = [] -> clocked g = g.
Proof.
  induction g as [v | x | p | o l IH | l r IHl IHr | l r IHl IHr] using guard_induction;
    simpl; intros P; auto; try discriminate.
  - f_equal. rewrite <- map_id. apply map_ext_in. intros g I. rewrite Forall_forall in IH. apply IH; auto.
    destruct (points g) as [| p k] eqn:Q; auto. exfalso.
    assert (X : In p (flat_map points l)) by (apply in_flat_map; exists g; rewrite Q; simpl; auto).
    rewrite P in X. destruct X.
  - apply app_eq_nil in P as [P Q]. now rewrite IHl, IHr.
  - apply app_eq_nil in P as [P Q]. now rewrite IHl, IHr.
Qed.
End Clock.
