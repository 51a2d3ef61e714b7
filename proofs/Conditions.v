(** * Conditions as one Boolean test of an assignment

    [consistent] decides whether events fit their occurrences under one assignment of the variables,
    and every known guard holds.  It is equivalent to [Consistent] of the definition, and it has the
    two laws that the search needs. *)

Require Import List Bool Arith ZArith Lia Permutation.
Require Import RVAFT.Values RVAFT.Language RVAFT.Definition RVAFT.Search.
Import ListNotations.

(** ** Lists of values with names *)

Section Bindings.
Context {K : Type}.
Variable same_key : K -> K -> bool.
Hypothesis same_key_iff : forall x y, same_key x y = true <-> x = y.

Definition binding := list (K * value).

Fixpoint lookup (bs : binding) (x : K) : option value :=
  match bs with
  | [] => None
  | (y, v) :: bs => if same_key x y then Some v else lookup bs x
  end.

Definition get (bs : binding) (x : K) : value := match lookup bs x with Some v => v | None => Null end.

(** No name has two values. *)
Definition agree (bs : binding) : bool := forallb (fun y => value_eqb (get bs (fst y)) (snd y)) bs.

Definition respects (a : K -> value) (bs : binding) : Prop := forall x v, In (x, v) bs -> a x = v.

Lemma lookup_in : forall bs x v, lookup bs x = Some v -> In (x, v) bs.
Proof.
  induction bs as [| [y w] bs IH]; simpl; intros x v H; [discriminate |].
  destruct (same_key x y) eqn:Q; [| right; auto].
  apply same_key_iff in Q; subst. injection H as ->; auto.
Qed.

Lemma lookup_bound : forall bs x, In x (map fst bs) -> exists v, lookup bs x = Some v.
Proof.
  induction bs as [| [y w] bs IH]; simpl; intros x H; [tauto |].
  destruct (same_key x y) eqn:Q; eauto. destruct H as [<- | H]; auto.
  rewrite (proj2 (same_key_iff y y) eq_refl) in Q; discriminate.
Qed.

Lemma respects_get : forall bs a x, respects a bs -> In x (map fst bs) -> get bs x = a x.
Proof.
  intros bs a x R I. destruct (lookup_bound bs x I) as [v L]. unfold get; rewrite L.
  symmetry; apply R. now apply lookup_in.
Qed.

Lemma agree_respects : forall bs, agree bs = true <-> respects (get bs) bs.
Proof.
  unfold agree, respects; intros. rewrite forallb_forall. split.
  - intros H x v I. apply H in I. now apply value_eqb_iff in I.
  - intros H [x v] I. apply value_eqb_iff. simpl; auto.
Qed.

Lemma respects_agree : forall bs a, respects a bs -> agree bs = true.
Proof.
  intros bs a R. apply agree_respects. intros x v I. rewrite (respects_get bs a x R); auto.
  apply (in_map fst) in I; auto.
Qed.

Lemma respects_app : forall a bs cs, respects a (bs ++ cs) <-> respects a bs /\ respects a cs.
Proof.
  unfold respects; intros; split; [intros H; split; intros; apply H, in_app_iff; auto |].
  intros [H J] x v I. apply in_app_iff in I as [I | I]; auto.
Qed.

End Bindings.
Arguments binding K : clear implicits.

(** All unions of one element of each of two lists. *)
Definition joined {A} (l m : list (list A)) : list (list A) := flat_map (fun x => map (app x) m) l.

Lemma in_joined : forall A (l m : list (list A)) z, In z (joined l m) <-> exists x y, In x l /\ In y m /\ z = x ++ y.
Proof.
  intros; unfold joined; rewrite in_flat_map; split.
  - intros (x & I & J). apply in_map_iff in J as (y & <- & J). eauto 6.
  - intros (x & y & I & J & ->). exists x; split; auto. now apply in_map.
Qed.

(** ** Patterns *)

Definition same_name (x y : name) : bool :=
  match x, y with
  | Rigid a, Rigid b | Local a, Local b => a =? b
  | _, _ => false
  end.

Lemma same_name_iff : forall x y, same_name x y = true <-> x = y.
Proof.
  intros [a | a] [b | b]; simpl; try (split; discriminate); rewrite Nat.eqb_eq; split; congruence.
Qed.

(** The ways in which a value matches a pattern: one for each choice of list items. *)
Fixpoint ways (p : pattern) (v : value) : list (binding name) :=
  match p with
  | Exactly w => if value_eqb v w then [[]] else []
  | Named x => [[(x, v)]]
  | Anything => [[]]
  | ObjectWith fields =>
    match v with
    | Object object =>
      (fix all fields := match fields with
         | [] => [[]]
         | (f, p) :: fields =>
           match field f object with
           | Some w => match ways p w with [] => [] | found => joined found (all fields) end
           | None => []
           end
         end) fields
    | _ => []
    end
  | ListOf items =>
    match v with
    | List list =>
      (fix all items list := match items, list with
         | [], [] => [[]]
         | p :: items, w :: list => joined (ways p w) (all items list)
         | _, _ => []
         end) items list
    | _ => []
    end
  | SomeItem p => match v with List list => flat_map (ways p) list | _ => [] end
  end.

(** Induction over patterns, with those of fields and items. *)
Section PatternInduction.
Variable P : pattern -> Prop.
Hypothesis on_exactly : forall v, P (Exactly v).
Hypothesis on_named : forall x, P (Named x).
Hypothesis on_anything : P Anything.
Hypothesis on_object : forall f, Forall (fun field => P (snd field)) f -> P (ObjectWith f).
Hypothesis on_list : forall l, Forall P l -> P (ListOf l).
Hypothesis on_some : forall p, P p -> P (SomeItem p).
Fixpoint pattern_induction (p : pattern) : P p :=
  match p with
  | Exactly v => on_exactly v
  | Named x => on_named x
  | Anything => on_anything
  | ObjectWith f => on_object f
      ((fix all f := match f return Forall (fun field => P (snd field)) f with
                     | [] => Forall_nil _
                     | field :: f => Forall_cons _ (pattern_induction (snd field)) (all f) end) f)
  | ListOf l => on_list l
      ((fix all l := match l return Forall P l with
                     | [] => Forall_nil _
                     | p :: l => Forall_cons _ (pattern_induction p) (all l) end) l)
  | SomeItem p => on_some p (pattern_induction p)
  end.
End PatternInduction.

Lemma respects_nil : forall K (a : K -> value), respects a [].
Proof. intros K a x v []. Qed.

Theorem ways_iff : forall b p v, matches b p v <-> exists bs, In bs (ways p v) /\ respects b bs.
Proof.
  intros b p; induction p as [w | x | | fields IH | items IH | p IH] using pattern_induction; intros v.
  - simpl. destruct (value_eqb v w) eqn:Q.
    + apply value_eqb_iff in Q. split; [intros _; exists []; simpl; auto using respects_nil | auto].
    + split; [intros ->; rewrite (proj2 (value_eqb_iff w w) eq_refl) in Q; discriminate | intros (bs & [] & _)].
  - simpl. split.
    + intros H; exists [(x, v)]; split; auto. intros y w [Q | []]. injection Q; intros; subst; auto.
    + intros (bs & [<- | []] & H). apply H; simpl; auto.
  - simpl. split; auto. intros _; exists []; simpl; auto using respects_nil.
  - cbn [matches ways]. split.
    + intros (object & -> & H). revert H.
      induction IH as [| [f p] fields IHp _ IHf]; intros H; [exists []; simpl; auto using respects_nil |].
      destruct H as [(w & F & M) H]. rewrite F. apply IHp in M as (bs & I & R). apply IHf in H as (cs & J & S).
      simpl in I. exists (bs ++ cs). split; [| apply respects_app; auto].
      destruct (ways p w) as [| x l] eqn:W; [destruct I |]. apply in_joined. exists bs, cs; auto.
    + intros (bs & I & R). destruct v as [| | | | | object |]; try destruct I. exists object; split; auto.
      revert bs I R. induction IH as [| [f p] fields IHp _ IHf]; intros bs I R; auto.
      destruct (field f object) as [w |] eqn:F; [| destruct I]. simpl in IHp.
      destruct (ways p w) as [| x l] eqn:W; [destruct I |]. rewrite <- W in I.
      apply in_joined in I as (cs & ds & I & J & ->). apply respects_app in R as [R S].
      split; [exists w; split; auto; apply IHp; eauto | eapply IHf; eauto].
  - cbn [matches ways]. split.
    + intros (list & -> & H). revert list H.
      induction IH as [| p items IHp _ IHi]; intros [| w list] H; try destruct H.
      * exists []; simpl; auto using respects_nil.
      * apply IHp in H as (bs & I & R). apply IHi in H0 as (cs & J & S).
        exists (bs ++ cs). split; [apply in_joined; exists bs, cs; auto | apply respects_app; auto].
    + intros (bs & I & R). destruct v as [| | | | list | |]; try destruct I. exists list; split; auto.
      revert list bs I R. induction IH as [| p items IHp _ IHi]; intros [| w list] bs I R; try destruct I; auto.
      apply in_joined in I as (cs & ds & I & J & ->). apply respects_app in R as [R S].
      split; [apply IHp; eauto | eapply IHi; eauto].
  - cbn [matches ways]. split.
    + intros (list & -> & w & I & M). apply IH in M as (bs & J & R). exists bs; split; auto.
      apply in_flat_map; eauto.
    + intros (bs & I & R). destruct v as [| | | | list | |]; try destruct I. exists list; split; auto.
      apply in_flat_map in I as (w & I & J). exists w; split; auto. apply IH; eauto.
Qed.

(** The values of the rigid variables. *)
Definition rigid (bs : binding name) : binding nat :=
  flat_map (fun y => match fst y with Rigid x => [(x, snd y)] | Local _ => [] end) bs.

Lemma in_rigid : forall bs x v, In (x, v) (rigid bs) <-> In (Rigid x, v) bs.
Proof.
  intros; unfold rigid; rewrite in_flat_map; split.
  - intros ([[y | y] w] & I & J); simpl in J; [| destruct J].
    destruct J as [J | []]. injection J; intros; subst; auto.
  - intros I. exists (Rigid x, v); simpl; auto.
Qed.

Fixpoint equal_bindings (l m : binding nat) : bool :=
  match l, m with
  | [], [] => true
  | (x, v) :: l, (y, w) :: m => (x =? y) && value_eqb v w && equal_bindings l m
  | _, _ => false
  end.

Lemma equal_bindings_iff : forall l m, equal_bindings l m = true -> l = m.
Proof.
  induction l as [| [x v] l IH]; destruct m as [| [y w] m]; simpl; try discriminate; auto.
  rewrite !andb_true_iff, Nat.eqb_eq, value_eqb_iff. intros [[-> ->] H]. now rewrite (IH m).
Qed.

Fixpoint distinct (l : list (binding nat)) : list (binding nat) :=
  match l with
  | [] => []
  | [x] => [x]
  | x :: l => let rest := distinct l in if existsb (equal_bindings x) rest then rest else x :: rest
  end.

Lemma in_distinct : forall l x, In x (distinct l) <-> In x l.
Proof.
  assert (S : forall x l, distinct (x :: l) =
    match l with [] => [x] | _ => if existsb (equal_bindings x) (distinct l) then distinct l else x :: distinct l end)
    by (destruct l; reflexivity).
  induction l as [| y l IH]; intros x; [simpl; tauto |]. rewrite S. destruct l as [| z l]; [simpl; tauto |].
  destruct (existsb (equal_bindings y) (distinct (z :: l))) eqn:Q.
  - rewrite IH. split; [simpl; auto |]. intros [<- | H]; auto. apply IH.
    apply existsb_exists in Q as (w & I & E). apply equal_bindings_iff in E as ->; auto.
  - simpl In at 1. rewrite IH. simpl; tauto.
Qed.

(** What a value gives to the rigid variables of a pattern; nothing if it does not match. *)
Definition bindings (p : pattern) (v : value) : list (binding nat) :=
  distinct (map rigid (filter (agree same_name) (ways p v))).

Theorem bindings_iff : forall a p v, fits_pattern a p v <-> exists bs, In bs (bindings p v) /\ respects a bs.
Proof.
  intros a p v; unfold fits_pattern, bindings. split.
  - intros (b & A & M). apply ways_iff in M as (bs & I & R). exists (rigid bs). split.
    + apply in_distinct, in_map, filter_In. split; auto. eapply respects_agree; eauto using same_name_iff.
    + intros x w J. rewrite <- A. apply R. now apply in_rigid.
  - intros (cs & I & R). apply in_distinct, in_map_iff in I as (bs & <- & I). apply filter_In in I as [I G].
    exists (fun x => match x with Rigid y => a y | Local y => get same_name bs x end). split; auto.
    apply ways_iff. exists bs; split; auto. apply agree_respects in G.
    intros [x | x] w J; [apply R; now apply in_rigid | now apply G].
Qed.

Lemma ways_variables : forall p v bs x, In bs (ways p v) -> In x (pattern_variables p) -> In (Rigid x) (map fst bs).
Proof.
  induction p as [w | y | | fields IH | items IH | p IH] using pattern_induction; intros v bs x I J.
  - destruct J.
  - simpl in I. destruct I as [<- | []]. destruct y; simpl in *; [destruct J as [<- | []]; auto | tauto].
  - destruct J.
  - cbn [ways] in I. destruct v as [| | | | | object |]; try destruct I.
    cbn [pattern_variables] in J. revert bs I J.
    induction IH as [| [f p] fields IHp _ IHf]; intros bs I J; [destruct J |].
    simpl in IHp. cbn [flat_map snd] in J.
    destruct (field f object) as [w |] eqn:F; [| destruct I].
    destruct (ways p w) as [| z l] eqn:W; [destruct I |]. rewrite <- W in I.
    apply in_joined in I as (cs & ds & I & K & ->). rewrite map_app, in_app_iff. apply in_app_iff in J as [J | J].
    + left; eapply IHp; eauto.
    + right; eapply IHf; eauto.
  - cbn [ways] in I. destruct v as [| | | | list | |]; try destruct I.
    cbn [pattern_variables] in J. revert list bs I J.
    induction IH as [| p items IHp _ IHi]; intros list bs I J; [destruct J |].
    destruct list as [| w list]; [destruct I |]. cbn [flat_map] in J.
    apply in_joined in I as (cs & ds & I & K & ->). rewrite map_app, in_app_iff. apply in_app_iff in J as [J | J].
    + left; eapply IHp; eauto.
    + right; eapply IHi; eauto.
  - cbn [ways] in I. destruct v as [| | | | list | |]; try destruct I.
    apply in_flat_map in I as (w & I & K). eapply IH; eauto.
Qed.

Lemma ways_names : forall p v bs x, In bs (ways p v) -> In (Rigid x) (map fst bs) -> In x (pattern_variables p).
Proof.
  induction p as [w | y | | fields IH | items IH | p IH] using pattern_induction; intros v bs x I J.
  - simpl in I. destruct (value_eqb v w); [destruct I as [<- | []]; destruct J | destruct I].
  - simpl in I. destruct I as [<- | []]. destruct J as [J | []]. simpl in J; subst. simpl; auto.
  - simpl in I. destruct I as [<- | []]. destruct J.
  - cbn [ways] in I. destruct v as [| | | | | object |]; try destruct I.
    cbn [pattern_variables]. revert bs I J. induction IH as [| [f p] fields IHp _ IHf]; intros bs I J.
    + destruct I as [<- | []]. destruct J.
    + simpl in IHp. cbn [flat_map snd]. destruct (field f object) as [w |] eqn:F; [| destruct I].
      destruct (ways p w) as [| z l] eqn:W; [destruct I |]. rewrite <- W in I.
      apply in_joined in I as (cs & ds & I & K & ->). rewrite map_app, in_app_iff in J. apply in_app_iff.
      destruct J as [J | J]; [left; eapply IHp; eauto | right; eapply IHf; eauto].
  - cbn [ways] in I. destruct v as [| | | | list | |]; try destruct I.
    cbn [pattern_variables]. revert list bs I J. induction IH as [| p items IHp _ IHi]; intros list bs I J.
    + destruct list; [destruct I as [<- | []]; destruct J | destruct I].
    + destruct list as [| w list]; [destruct I |]. cbn [flat_map].
      apply in_joined in I as (cs & ds & I & K & ->). rewrite map_app, in_app_iff in J. apply in_app_iff.
      destruct J as [J | J]; [left; eapply IHp; eauto | right; eapply IHi; eauto].
  - cbn [ways] in I. destruct v as [| | | | list | |]; try destruct I.
    apply in_flat_map in I as (w & I & K). eapply IH; eauto.
Qed.

Lemma bindings_variables : forall p v bs x, In bs (bindings p v) -> In x (pattern_variables p) -> In x (map fst bs).
Proof.
  unfold bindings; intros p v bs x I J. apply in_distinct, in_map_iff in I as (cs & <- & I).
  apply filter_In in I as [I _].
  apply (ways_variables _ _ _ _ I) in J. apply in_map_iff in J as ([y w] & Q & J). simpl in Q; subst.
  apply in_rigid in J. apply (in_map fst) in J; auto.
Qed.

Lemma bindings_names : forall p v bs x, In bs (bindings p v) -> In x (map fst bs) -> In x (pattern_variables p).
Proof.
  unfold bindings; intros p v bs x I J. apply in_distinct, in_map_iff in I as (cs & <- & I).
  apply filter_In in I as [I _].
  apply in_map_iff in J as ([y w] & Q & J). simpl in Q; subst. apply in_rigid in J.
  apply (ways_names p v cs); auto. apply (in_map fst) in J; auto.
Qed.

Lemma bindings_agree : forall p v bs, In bs (bindings p v) -> respects (get Nat.eqb bs) bs.
Proof.
  unfold bindings; intros p v bs I. apply in_distinct, in_map_iff in I as (cs & <- & I). apply filter_In in I as [I G].
  apply agree_respects in G.
  assert (R : respects (fun x => get same_name cs (Rigid x)) (rigid cs)) by (intros x w J; apply G; now apply in_rigid).
  apply agree_respects. eapply respects_agree; eauto using Nat.eqb_eq.
Qed.

(** Whether a value fits depends only on the variables of the pattern. *)
Lemma fits_pattern_same : forall a a' p v, (forall x, In x (pattern_variables p) -> a x = a' x) ->
  fits_pattern a p v -> fits_pattern a' p v.
Proof.
  intros a a' p v S F. apply bindings_iff in F as (bs & I & R). apply bindings_iff. exists bs; split; auto.
  intros x w J. rewrite <- S; [auto |]. apply (bindings_names p v bs); auto. apply (in_map fst) in J; auto.
Qed.

(** ** Guards *)

Section GuardInduction.
Variable P : guard -> Prop.
Hypothesis on_constant : forall v, P (Constant v).
Hypothesis on_value : forall x, P (ValueOf x).
Hypothesis on_time : forall p, P (TimeOf p).
Hypothesis on_apply : forall o l, Forall P l -> P (Apply o l).
Hypothesis on_and : forall a b, P a -> P b -> P (AndThen a b).
Hypothesis on_or : forall a b, P a -> P b -> P (OrElse a b).
Fixpoint guard_induction (g : guard) : P g :=
  match g with
  | Constant v => on_constant v
  | ValueOf x => on_value x
  | TimeOf p => on_time p
  | Apply o l => on_apply o l
      ((fix all l := match l return Forall P l with
                     | [] => Forall_nil _
                     | g :: l => Forall_cons _ (guard_induction g) (all l) end) l)
  | AndThen a b => on_and a b (guard_induction a) (guard_induction b)
  | OrElse a b => on_or a b (guard_induction a) (guard_induction b)
  end.
End GuardInduction.

Lemma eval_same : forall a a' time time' g,
  (forall x, In x (variables g) -> a x = a' x) -> (forall p, In p (points g) -> time p = time' p) ->
  eval a time g = eval a' time' g.
Proof.
  intros a a' time time' g; induction g as [v | x | p | o l IH | l r IHl IHr | l r IHl IHr] using guard_induction;
    simpl; intros HV HP; auto.
  - now rewrite (HV x) by auto.
  - now rewrite (HP p) by auto.
  - rewrite (map_ext_in (eval a time) (eval a' time') l); auto. intros g I. rewrite Forall_forall in IH.
    apply IH; auto; intros y J; [apply HV | apply HP]; apply in_flat_map; eauto.
  - rewrite IHl, IHr; auto; intros; (apply HV || apply HP); apply in_app_iff; auto.
  - rewrite IHl, IHr; auto; intros; (apply HV || apply HP); apply in_app_iff; auto.
Qed.

Lemma holds_same : forall a a' time time' g,
  (forall x, In x (variables g) -> a x = a' x) -> (forall p, In p (points g) -> time p = time' p) ->
  holds a time g = holds a' time' g.
Proof. intros; unfold holds; erewrite eval_same; eauto. Qed.

(** ** Times *)

Definition seen {E} (m : assigned E) (o : occurrence) : option E := option_map snd (find (fun x => same o (fst x)) m).

Lemma seen_iff : forall E (m : assigned E) o e, NoDup (domain m) -> (seen m o = Some e <-> In (o, e) m).
Proof.
  unfold seen; induction m as [| [p f] m IH]; simpl; intros o e N; [split; [discriminate | tauto] |].
  inversion N as [| ? ? NI N']; subst. destruct (same o p) eqn:Q; simpl.
  - apply same_iff in Q; subst.
    split; [intros H; injection H as ->; auto | intros [H | H]; [injection H as ->; auto |]].
    exfalso; apply NI. apply in_domain; eauto.
  - rewrite IH by auto. split; auto. intros [H | H]; auto. injection H; intros; subst. now rewrite same_refl in Q.
Qed.

Definition time_seen (m : assigned event) (o : occurrence) : option Z :=
  match seen m o with Some e => time_of e | None => None end.

(** The least or the greatest time of the occurrences of a part. *)
Definition extreme_time (choose : Z -> Z -> Z) (m : assigned event) (part : list occurrence) : option Z :=
  match all_defined (map (time_seen m) part) with
  | Some (t :: l) => Some (fold_left choose l t)
  | _ => None
  end.

(** The occurrences whose times a point asks for. *)
Definition asked_by (part : nat -> list occurrence) (p : point) : list occurrence :=
  match p with At n => [(n, 0)] | Start n | End n => part n end.

Definition time_at (part : nat -> list occurrence) (m : assigned event) (p : point) : option Z :=
  match p with
  | At n => time_seen m (n, 0)
  | Start n => extreme_time Z.min m (part n)
  | End n => extreme_time Z.max m (part n)
  end.

Lemma all_defined_iff : forall A (l : list (option A)) r, all_defined l = Some r <-> l = map Some r.
Proof.
  induction l as [| [x |] l IH]; simpl; intros r.
  - split; [intros H; injection H as <-; auto | destruct r; [auto | discriminate]].
  - destruct (all_defined l) as [r' |] eqn:C; simpl.
    + split.
      * intros H; injection H as <-. simpl. f_equal. now apply IH.
      * destruct r; simpl; [discriminate |]. intros H; injection H as -> H. apply IH in H. congruence.
    + split; [discriminate |]. destruct r; simpl; [discriminate |]. intros H; injection H as -> H. apply IH in H.
      discriminate.
  - split; [discriminate | destruct r; discriminate].
Qed.

Section Extremes.
Variable choose : Z -> Z -> Z.
Variable le : Z -> Z -> Prop.
Hypothesis le_refl : forall x, le x x.
Hypothesis le_trans : forall x y z, le x y -> le y z -> le x z.
Hypothesis le_antisym : forall x y, le x y -> le y x -> x = y.
Hypothesis choose_one : forall x y, choose x y = x \/ choose x y = y.
Hypothesis choose_le : forall x y, le (choose x y) x /\ le (choose x y) y.

Lemma fold_choose : forall l t, In (fold_left choose l t) (t :: l) /\ forall x, In x (t :: l) ->
  le (fold_left choose l t) x.
Proof.
  induction l as [| y l IH]; simpl; intros t.
  - split; auto. intros x [<- | []]; auto.
  - destruct (IH (choose t y)) as [A B]. split.
    + destruct A as [A | A]; [| auto]. rewrite <- A. destruct (choose_one t y) as [-> | ->]; auto.
    + intros x I. assert (L := B _ (or_introl eq_refl)). destruct (choose_le t y) as [C D].
      destruct I as [<- | [<- | I]]; [eauto | eauto | apply B; simpl; auto].
Qed.

Lemma extreme_time_iff : forall t r m n part z, NoDup (domain m) -> (forall o, In o part <-> InPart t r n o) ->
  (extreme_time choose m part = Some z <-> Bounds t r m le n z).
Proof.
  intros t r m n part z N P; unfold extreme_time, Bounds.
  set (f := time_seen m).
  assert (F : forall o z, f o = Some z <-> exists e, In (o, e) m /\ time_of e = Some z).
  { intros o y; unfold f, time_seen. split.
    - destruct (seen m o) as [e |] eqn:S; [| discriminate]. intros T. exists e; split; auto. now apply seen_iff.
    - intros (e & I & T). apply seen_iff in I as ->; auto. }
  split.
  - destruct (all_defined (map f part)) as [[| y l] |] eqn:A; try discriminate. intros H; injection H as <-.
    apply all_defined_iff in A. destruct (fold_choose l y) as [B C]. split.
    + apply (in_map Some) in B. rewrite <- A in B. apply in_map_iff in B as (o & Q & I).
      apply F in Q as (e & J & T). exists o, e; split; [now apply P | auto].
    + intros o I. apply P in I. apply (in_map f) in I. rewrite A in I. apply in_map_iff in I as (w & Q & I).
      symmetry in Q. apply F in Q as (e & J & T). exists e, w; auto.
  - intros [(o & e & I & J & T) B].
    assert (A : exists l, map f part = map Some l).
    { assert (G : forall o, In o part -> exists z, f o = Some z).
      { intros p K. apply P, B in K as (e' & z' & K & T' & _). exists z'. apply F; eauto. }
      clear - G. induction part as [| p part IH]; [exists []; auto |].
      destruct (G p) as [z Z]; simpl; auto. destruct IH as [l L]; [intros; apply G; simpl; auto |].
      exists (z :: l); simpl; congruence. }
    destruct A as [l A]. rewrite (proj2 (all_defined_iff _ _ _) A).
    assert (Z : In z l).
    { assert (K : In (f o) (map f part)) by (apply in_map, P; auto). rewrite A in K.
      apply in_map_iff in K as (z' & Q & K). rewrite (proj2 (F o z)) in Q by eauto. injection Q as ->; auto. }
    destruct l as [| y l]; [destruct Z |]. f_equal. destruct (fold_choose l y) as [C D].
    apply le_antisym; [now apply D |].
    apply (in_map Some) in C. rewrite <- A in C. apply in_map_iff in C as (p & Q & K).
    apply P, B in K as (e' & z' & K & T' & LE). rewrite (proj2 (F p z')) in Q by eauto. injection Q as <-; auto.
Qed.
End Extremes.

Lemma time_at_iff : forall t r m part p z, NoDup (domain m) -> (forall n o, In o (part n) <-> InPart t r n o) ->
  (time_at part m p = Some z <-> IsTime t r m p z).
Proof.
  intros t r m part [n | n | n] z N P; simpl.
  - unfold time_seen. split.
    + destruct (seen m (n, 0)) as [e |] eqn:S; [| discriminate]. intros T. exists e; split; auto. now apply seen_iff.
    + intros (e & I & T). apply seen_iff in I as ->; auto.
  - apply extreme_time_iff; auto; try lia; intros; lia.
  - apply extreme_time_iff; auto; try lia; intros; lia.
Qed.

(** ** The test *)

Section Test.
Variable t : tree.
Variable guards : list guard.
Variable part : nat -> list occurrence.

Definition observed (o : occurrence) (e : event) : list (binding nat) :=
  if late e then []
  else match on (node_at t (fst o)) with Some p => bindings p (content e) | None => [] end.

Fixpoint unions (m : assigned event) : list (binding nat) :=
  match m with
  | [] => [[]]
  | (o, e) :: m => match observed o e with [] => [] | found => joined found (unions m) end
  end.

Definition bound_variables (m : assigned event) : list nat :=
  flat_map (fun o => match on (node_at t (fst o)) with Some p => pattern_variables p | None => [] end) (domain m).

Definition member (x : nat) (l : list nat) : bool := existsb (Nat.eqb x) l.

Definition known (m : assigned event) (g : guard) : bool :=
  forallb (fun x => member x (bound_variables m)) (variables g) &&
  forallb (fun p => forallb (fun o => among o (domain m)) (asked_by part p)) (points g).

Definition solves (asked : list guard) (m : assigned event) (bs : binding nat) : bool :=
  agree Nat.eqb bs && forallb (holds (get Nat.eqb bs) (time_at part m)) asked.

Definition consistent (m : assigned event) : bool :=
  let asked := filter (known m) guards in existsb (solves asked m) (unions m).

Variable r : resolution.
Hypothesis part_iff : forall n o, In o (part n) <-> InPart t r n o.
Hypothesis guards_iff : forall g, In g guards <-> exists n, In n (map fst r) /\ In g (conditions t n).

Lemma member_iff : forall x l, member x l = true <-> In x l.
Proof.
  unfold member; intros; rewrite existsb_exists; split.
  - intros (y & I & Q). apply Nat.eqb_eq in Q; subst; auto.
  - intros I; exists x; split; auto. apply Nat.eqb_refl.
Qed.

Lemma known_iff : forall m g, known m g = true <-> Known t r m g.
Proof.
  intros m g; unfold known, Known. rewrite andb_true_iff, !forallb_forall.
  assert (B : forall x, In x (bound_variables m) <->
    exists o p, In o (domain m) /\ on (node_at t (fst o)) = Some p /\ In x (pattern_variables p)).
  { intros x; unfold bound_variables; rewrite in_flat_map. split.
    - intros (o & I & J). destruct (on (node_at t (fst o))) as [p |] eqn:P; [| destruct J]. exists o, p; auto.
    - intros (o & p & I & P & J). exists o; split; auto. now rewrite P. }
  assert (A : forall p, (forall o, In o (asked_by part p) -> In o (domain m)) <->
    match p with At n => In (n, 0) (domain m) | Start n | End n => forall o, InPart t r n o -> In o (domain m) end).
  { intros [n | n | n]; simpl.
    - split; [intros H; apply H; auto | intros H o [<- | []]; auto].
    - split; intros H o I; apply H, part_iff, I.
    - split; intros H o I; apply H, part_iff, I. }
  split; intros [X Y]; split.
  - intros x I. apply B, member_iff; auto.
  - intros p I. apply A. apply Y in I. rewrite forallb_forall in I. intros o J. apply among_iff, I, J.
  - intros x I. apply member_iff, B; auto.
  - intros p I. apply forallb_forall. intros o J. apply among_iff. now apply (proj2 (A p)) in J; [| apply Y].
Qed.

Lemma observed_iff : forall a o e, Fits t a o e <-> exists bs, In bs (observed o e) /\ respects a bs.
Proof.
  intros a o e; unfold Fits, observed.
  destruct (late e); [split; [intros [? _]; discriminate | intros (bs & [] & _)] |].
  destruct (on (node_at t (fst o))) as [p |].
  - rewrite <- bindings_iff. split; [intros (_ & q & Q & F); injection Q as ->; auto | intros F; split; eauto].
  - split; [intros (_ & q & Q & _); discriminate | intros (bs & [] & _)].
Qed.

Lemma in_unions : forall o e m z,
  In z (unions ((o, e) :: m)) <-> exists x y, In x (observed o e) /\ In y (unions m) /\ z = x ++ y.
Proof.
  intros. transitivity (In z (joined (observed o e) (unions m))); [| apply in_joined].
  simpl. destruct (observed o e); [simpl; tauto | reflexivity].
Qed.

Lemma unions_iff : forall a m, (forall o e, In (o, e) m ->
  Fits t a o e) <-> exists bs, In bs (unions m) /\ respects a bs.
Proof.
  intros a; induction m as [| [o e] m IH].
  - split; [intros _; exists []; split; simpl; auto; apply respects_nil | intros _ ? ? []].
  - split.
    + intros H. destruct (proj1 (observed_iff a o e)) as (bs & I & R); [apply H; simpl; auto |].
      destruct (proj1 IH) as (cs & K & S); [intros; apply H; simpl; auto |].
      exists (bs ++ cs); split; [apply in_unions; exists bs, cs; auto | apply respects_app; auto].
    + intros (ds & I & R). apply in_unions in I as (bs & cs & I & K & ->). apply respects_app in R as [R S].
      intros p f [Q | L].
      * injection Q; intros; subst. apply observed_iff. eauto.
      * apply (proj2 IH); eauto.
Qed.

Lemma unions_variables : forall m bs x, In bs (unions m) -> In x (bound_variables m) -> In x (map fst bs).
Proof.
  induction m as [| [o e] m IH]; intros bs x I J; [destruct J |].
  apply in_unions in I as (cs & ds & I & K & ->). rewrite map_app, in_app_iff.
  unfold bound_variables in J; simpl in J. apply in_app_iff in J as [J | J]; [left | right; apply IH; auto].
  unfold observed in I. destruct (late e); [destruct I |]. destruct (on (node_at t (fst o))); [| destruct J].
  eapply bindings_variables; eauto.
Qed.

(** [m] is consistent under one assignment of the variables. *)
Definition Under (a : nat -> value) (m : assigned event) : Prop :=
  (forall o e, In (o, e) m -> Fits t a o e) /\
  (forall g, In g guards -> known m g = true -> holds a (time_at part m) g = true).

Lemma under_iff : forall a m, Under a m <->
  exists bs, In bs (unions m) /\ respects a bs /\ solves (filter (known m) guards) m bs = true.
Proof.
  intros a m. unfold Under, solves.
  assert (SAME : forall bs g, In bs (unions m) -> respects a bs -> known m g = true ->
    holds (get Nat.eqb bs) (time_at part m) g = holds a (time_at part m) g).
  { intros bs g I R K. apply holds_same; auto. intros x X. unfold known in K. apply andb_true_iff in K as [K _].
    rewrite forallb_forall in K. apply (respects_get Nat.eqb Nat.eqb_eq); auto.
    apply (unions_variables m); auto. now apply member_iff, K. }
  split.
  - intros [F G]. apply unions_iff in F as (bs & I & R). exists bs; split; [auto | split; [auto |]].
    apply andb_true_iff; split; [eapply respects_agree; eauto using Nat.eqb_eq |].
    apply forallb_forall. intros g J. apply filter_In in J as [J K]. rewrite SAME; auto.
  - intros (bs & I & R & H). apply andb_true_iff in H as [_ H]. rewrite forallb_forall in H.
    split; [apply unions_iff; eauto |]. intros g J K. rewrite <- (SAME bs); auto. apply H, filter_In; auto.
Qed.

Lemma consistent_under : forall m, consistent m = true <-> exists a, Under a m.
Proof.
  intros m. unfold consistent. rewrite existsb_exists. split.
  - intros (bs & I & H). exists (get Nat.eqb bs). apply under_iff. exists bs; split; [auto | split; [| auto]].
    apply andb_true_iff in H as [H _]. now apply agree_respects.
  - intros (a & H). apply under_iff in H as (bs & I & _ & H). eauto.
Qed.

Theorem consistent_iff : forall m, NoDup (domain m) -> (consistent m = true <-> Consistent t r m).
Proof.
  intros m N. rewrite consistent_under. unfold Under, Consistent.
  assert (T : forall time, (forall p z, time p = Some z <-> IsTime t r m p z) -> forall p, time p = time_at part m p).
  { intros time H p. destruct (time_at part m p) as [z |] eqn:Q.
    - apply H, (time_at_iff t r m part); auto.
    - destruct (time p) as [z |] eqn:R; auto. apply H, (time_at_iff t r m part) in R; auto. congruence. }
  split.
  - intros (a & F & G). exists a, (time_at part m). split; [auto | split].
    + intros; now apply time_at_iff.
    + intros n g I J K. apply G; [apply guards_iff; eauto | now apply known_iff].
  - intros (a & time & F & C & G). exists a; split; [auto |]. intros g J K.
    apply guards_iff in J as (n & I & J). apply known_iff in K. rewrite <- (G n g I J K).
    apply holds_same; auto. intros; symmetry; now apply T.
Qed.

Lemma time_at_same : forall m m' p, (forall o, In o (asked_by part p) -> time_seen m o = time_seen m' o) ->
  time_at part m p = time_at part m' p.
Proof.
  intros m m' [n | n | n] H; simpl in *; [apply H; auto | |]; unfold extreme_time;
    erewrite map_ext_in; eauto.
Qed.

Lemma known_same : forall m m' g, (forall o, In o (domain m) <-> In o (domain m')) -> known m g = known m' g.
Proof.
  intros m m' g D. apply eq_true_iff_eq. rewrite !known_iff. unfold Known.
  split; intros [K1 K2]; (split; [intros x X; destruct (K1 x X) as (o & p & I & J); exists o, p; rewrite ?D in *;
    auto; rewrite <- D; auto |]).
  - intros p X. specialize (K2 p X). destruct p; [now apply D | |]; intros o I; apply D; auto.
  - intros p X. specialize (K2 p X). destruct p; [now apply D | |]; intros o I; apply D; auto.
Qed.

Lemma known_part : forall m m' g, incl (domain m') (domain m) -> known m' g = true -> known m g = true.
Proof.
  intros m m' g D. rewrite !known_iff. intros [K1 K2]. split.
  - intros x X. destruct (K1 x X) as (o & p & Y & Z). exists o, p; split; auto.
  - intros p X. specialize (K2 p X). destruct p; auto.
Qed.

Lemma known_asked : forall m g p o, known m g = true -> In p (points g) -> In o (asked_by part p) -> In o (domain m).
Proof.
  intros m g p o K P I. unfold known in K. apply andb_true_iff in K as [_ K]. rewrite forallb_forall in K.
  specialize (K p P). rewrite forallb_forall in K. now apply among_iff, K.
Qed.

Lemma under_part : forall a m m', NoDup (domain m) -> NoDup (domain m') -> incl m' m -> Under a m -> Under a m'.
Proof.
  intros a m m' N N' I [F G]. split; [auto |]. intros g J K.
  assert (D : incl (domain m') (domain m)).
  { intros o X. apply in_domain in X as [e X]. apply in_domain; eauto. }
  rewrite <- (G g J (known_part m m' g D K)). apply holds_same; auto. intros p X.
  apply time_at_same. intros o O. apply (known_asked m' g p o K X) in O. apply in_domain in O as [e O].
  unfold time_seen. rewrite (proj2 (seen_iff _ m' o e N') O), (proj2 (seen_iff _ m o e N)); auto.
Qed.

(** The two laws of the search. *)
Theorem consistent_lawful : forall os before, lawful (Plan os before consistent).
Proof.
  intros os before; constructor; simpl.
  - intros m m' N P H. assert (N' : NoDup (domain m')) by (apply (Permutation_NoDup (Permutation_map fst P) N)).
    apply consistent_under in H as [a H]. apply consistent_under. exists a. apply (under_part a m m'); auto.
    intros x I. now apply (Permutation_in _ (Permutation_sym P)).
  - intros x m N H. assert (N' : NoDup (domain m)) by (simpl in N; inversion N; auto).
    apply consistent_under in H as [a H]. apply consistent_under. exists a. apply (under_part a (x :: m) m); auto.
    intros y I; simpl; auto.
Qed.
End Test.
