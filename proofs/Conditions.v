(** * Conditions as one Boolean test of an assignment

    [consistent] decides whether events fit their occurrences under one assignment of the variables,
    and every known guard holds.  It is equivalent to [Consistent] of the definition, and it has the
    two laws that the search needs. *)

Require Import List Bool Arith ZArith Lia Permutation.
Require Import RVAFT.Values RVAFT.Language RVAFT.Definition RVAFT.Search.
Require Arith.Cantor.
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

(** ** Variables of one's own

    Each event of a node has its own values of some variables (clause 2.9).  The monitor gives these
    variables one name for each event, and has one assignment for all. *)

Section Renaming.
Variable f : nat -> nat.

Definition rename_name (x : name) : name :=
  match x with Rigid x => Rigid (f x) | Language.Local x => Language.Local x end.

Fixpoint rename_pattern (p : pattern) : pattern :=
  match p with
  | Exactly v => Exactly v
  | Named x => Named (rename_name x)
  | Anything => Anything
  | ObjectWith fields => ObjectWith (map (fun field => (fst field, rename_pattern (snd field))) fields)
  | ListOf items => ListOf (map rename_pattern items)
  | SomeItem p => SomeItem (rename_pattern p)
  end.

Fixpoint rename_guard (g : guard) : guard :=
  match g with
  | Constant v => Constant v
  | ValueOf x => ValueOf (f x)
  | TimeOf p => TimeOf p
  | Apply o l => Apply o (map rename_guard l)
  | AndThen a b => AndThen (rename_guard a) (rename_guard b)
  | OrElse a b => OrElse (rename_guard a) (rename_guard b)
  end.

Lemma flat_map_map : forall A B C (g : B -> list C) (h : A -> B) l,
  flat_map g (map h l) = flat_map (fun x => g (h x)) l.
Proof. induction l; simpl; congruence. Qed.

Lemma flat_map_ext_in : forall A B (g h : A -> list B) l, (forall x, In x l -> g x = h x) ->
  flat_map g l = flat_map h l.
Proof. induction l; simpl; intros H; auto. rewrite H, IHl; auto. Qed.

Lemma map_flat_map : forall A B C (g : B -> C) (h : A -> list B) l,
  map g (flat_map h l) = flat_map (fun x => map g (h x)) l.
Proof. induction l; simpl; auto. now rewrite map_app, IHl. Qed.

Lemma renamed_matches : forall b b' p v, (forall x, b' (Rigid x) = b (Rigid (f x))) ->
  (forall x, b' (Local x) = b (Local x)) -> (matches b (rename_pattern p) v <-> matches b' p v).
Proof.
  intros b b' p v R L; revert v.
  induction p as [w | x | | fields IH | items IH | p IH] using pattern_induction; intros v.
  - reflexivity.
  - destruct x; simpl; [now rewrite R | now rewrite L].
  - reflexivity.
  - cbn [matches rename_pattern]. assert (S : forall object, 
      (fix all fields := match fields with
         | [] => True
         | (f, p) :: fields => (exists w, field f object = Some w /\ matches b p w) /\ all fields
         end) (map (fun field => (fst field, rename_pattern (snd field))) fields) <->
      (fix all fields := match fields with
         | [] => True
         | (f, p) :: fields => (exists w, field f object = Some w /\ matches b' p w) /\ all fields
         end) fields).
    { intros object. induction IH as [| [g p] fields IHp _ IHf]; simpl; [tauto |]. rewrite IHf. simpl in IHp.
      split; intros [(w & F & M) H]; (split; [exists w; split; auto; now apply IHp | auto]). }
    split; intros (object & -> & H); exists object; (split; [auto |]); now apply S.
  - cbn [matches rename_pattern]. assert (S : forall list, 
      (fix all items list := match items, list with
         | [], [] => True
         | p :: items, w :: list => matches b p w /\ all items list
         | _, _ => False
         end) (map rename_pattern items) list <->
      (fix all items list := match items, list with
         | [], [] => True
         | p :: items, w :: list => matches b' p w /\ all items list
         | _, _ => False
         end) items list).
    { induction IH as [| p items IHp _ IHi]; intros [| w list]; simpl; try tauto. now rewrite IHi, IHp. }
    split; intros (list & -> & H); exists list; (split; [auto |]); now apply S.
  - simpl. split; intros (list & -> & w & I & M); exists list; (split; [auto |]); exists w; (split; [auto |]);
      now apply IH.
Qed.

Lemma renamed_fits : forall a p v, fits_pattern a (rename_pattern p) v <-> fits_pattern (fun x => a (f x)) p v.
Proof.
  intros a p v. split; intros (b & R & M).
  - exists (fun x => match x with Rigid x => b (Rigid (f x)) | Local x => b (Local x) end).
    split; [intros; simpl; auto |]. now apply renamed_matches with b.
  - exists (fun x => match x with Rigid x => a x | Local x => b (Local x) end). split; auto.
    eapply renamed_matches; [| | exact M]; intros; simpl; auto.
Qed.

Lemma renamed_pattern_variables : forall p, pattern_variables (rename_pattern p) = map f (pattern_variables p).
Proof.
  induction p as [w | x | | fields IH | items IH | p IH] using pattern_induction; simpl; auto.
  - now destruct x.
  - rewrite flat_map_map, map_flat_map. apply flat_map_ext_in. rewrite Forall_forall in IH. intros [g p] I. simpl.
    now apply (IH (g, p)).
  - rewrite flat_map_map, map_flat_map. apply flat_map_ext_in. now rewrite Forall_forall in IH.
Qed.

Lemma renamed_eval : forall a time g, eval a time (rename_guard g) = eval (fun x => a (f x)) time g.
Proof.
  intros a time; induction g as [v | x | p | o l IH | l r IHl IHr | l r IHl IHr] using guard_induction; simpl; auto.
  - rewrite map_map. rewrite (map_ext_in (fun x => eval a time (rename_guard x)) (eval (fun x => a (f x)) time)); auto.
    now rewrite Forall_forall in IH.
  - now rewrite IHl, IHr.
  - now rewrite IHl, IHr.
Qed.

Lemma renamed_holds : forall a time g, holds a time (rename_guard g) = holds (fun x => a (f x)) time g.
Proof. intros; unfold holds; now rewrite renamed_eval. Qed.

Lemma renamed_variables : forall g, variables (rename_guard g) = map f (variables g).
Proof.
  induction g as [v | x | p | o l IH | l r IHl IHr | l r IHl IHr] using guard_induction; simpl; auto.
  - rewrite flat_map_map, map_flat_map. apply flat_map_ext_in. now rewrite Forall_forall in IH.
  - now rewrite map_app, IHl, IHr.
  - now rewrite map_app, IHl, IHr.
Qed.

Lemma renamed_points : forall g, points (rename_guard g) = points g.
Proof.
  induction g as [v | x | p | o l IH | l r IHl IHr | l r IHl IHr] using guard_induction; simpl; auto.
  - rewrite flat_map_map. apply flat_map_ext_in. now rewrite Forall_forall in IH.
  - now rewrite IHl, IHr.
  - now rewrite IHl, IHr.
Qed.
End Renaming.

(** The variables of a node, and a number above those of all nodes. *)
Definition names_at (t : tree) (n : nat) : list nat :=
  match on (node_at t n) with Some p => pattern_variables p | None => [] end ++
  flat_map variables (conditions t n) ++ distinct_values (node_at t n).
Definition fresh (t : tree) : nat := S (list_max (flat_map (names_at t) (seq 0 (length (nodes t))))).

(** The name of a variable for an occurrence. *)
Definition own_name (t : tree) (o : occurrence) (x : nat) : nat := x + fresh t * S (Cantor.to_nat o).
Definition rename (t : tree) (o : occurrence) (x : nat) : nat := if is_own t o x then own_name t o x else x.

(** What an occurrence observes, and the guards of a node, with one name for each value. *)
Definition pattern_at (t : tree) (o : occurrence) : option pattern :=
  if is_nil (own_values (node_at t (fst o))) then on (node_at t (fst o))
  else option_map (rename_pattern (rename t o)) (on (node_at t (fst o))).

Definition names_differ (t : tree) (o p : occurrence) (xs : list nat) : guard :=
  differ (map (fun x => (ValueOf (own_name t o x), ValueOf (own_name t p x))) xs).

Definition guards_at (t : tree) (n : nat) : list guard :=
  let d := node_at t n in
  if is_nil (own_values d) then conditions t n
  else let events := map (pair n) (seq 0 (S (pred (times d)))) in
       flat_map (fun o => map (rename_guard (rename t o)) (conditions t n)) events ++
       (if is_nil (distinct_values d) then []
        else flat_map (fun o => flat_map (fun p =>
               if snd o <? snd p then [names_differ t o p (distinct_values d)] else []) events) events).

(** The values of variables by their names. *)
Definition named_values (t : tree) (a : nat -> value) (own : occurrence -> nat -> value) (y : nat) : value :=
  if y <? fresh t then a y else own (Cantor.of_nat (pred (y / fresh t))) (y mod fresh t).

Section OwnValues.
Variable t : tree.

Lemma in_names : forall n x, In x (names_at t n) -> x < fresh t.
Proof.
  intros n x I. destruct (le_lt_dec (length (nodes t)) n) as [L | L].
  - unfold names_at, conditions, node_at in I. rewrite nth_overflow in I by auto. destruct I.
  - unfold fresh. apply Nat.lt_succ_r.
    assert (F := proj1 (list_max_le (flat_map (names_at t) (seq 0 (length (nodes t)))) _) (le_n _)).
    rewrite Forall_forall in F. apply F, in_flat_map. exists n; split; auto. apply in_seq; lia.
Qed.

Lemma named_own : forall a own o x, x < fresh t -> named_values t a own (own_name t o x) = own o x.
Proof.
  intros a own o x L. unfold named_values, own_name. replace (_ <? _) with false.
  - rewrite Nat.mul_comm, Nat.div_add, Nat.mod_add by lia. rewrite Nat.div_small, Nat.mod_small by auto. simpl.
    now rewrite Cantor.cancel_of_to.
  - symmetry. apply Nat.ltb_ge. rewrite Nat.mul_succ_r. lia.
Qed.

Lemma named_under : forall a own o x, x < fresh t -> named_values t a own (rename t o x) = values_for t a own o x.
Proof.
  intros a own o x L. unfold rename, values_for. destruct (is_own t o x); [now apply named_own |].
  unfold named_values. now rewrite (proj2 (Nat.ltb_lt _ _) L).
Qed.

Lemma own_name_one : forall o p x y, x < fresh t -> y < fresh t -> own_name t o x = own_name t p y -> o = p /\ x = y.
Proof.
  intros o p x y L M Q. unfold own_name in Q.
  assert (Z : fresh t * S (Cantor.to_nat o) + x = fresh t * S (Cantor.to_nat p) + y) by lia.
  apply Nat.div_mod_unique in Z; auto. destruct Z as [Z ->]. split; auto. apply Cantor.to_nat_inj. lia.
Qed.

Lemma own_name_high : forall o x, fresh t <= own_name t o x.
Proof. intros o x. unfold own_name. rewrite Nat.mul_succ_r. lia. Qed.

Lemma rename_one : forall o p x y, x < fresh t -> y < fresh t ->
  (rename t o x = rename t p y <-> x = y /\ if is_own t o x then p = o else is_own t p x = false).
Proof.
  intros o p x y L M. unfold rename. split.
  - intros Q. destruct (is_own t o x) eqn:O, (is_own t p y) eqn:P.
    + destruct (own_name_one o p x y L M Q); auto.
    + assert (H := own_name_high o x). lia.
    + assert (H := own_name_high p y). lia.
    + subst; auto.
  - intros [<- H]. destruct (is_own t o x) eqn:O; [subst; now rewrite O | now rewrite H].
Qed.

Lemma no_own : forall o x, own_values (node_at t (fst o)) = [] -> is_own t o x = false.
Proof. intros o x Q. unfold is_own. now rewrite Q. Qed.

(** Patterns under one assignment are patterns under that of their event. *)
Lemma pattern_at_iff : forall a o p, pattern_at t o = Some p ->
  exists q, on (node_at t (fst o)) = Some q /\ pattern_variables p = map (rename t o) (pattern_variables q) /\
    forall v, fits_pattern a p v <-> fits_pattern (fun x => a (rename t o x)) q v.
Proof.
  intros a o p H. unfold pattern_at in H. destruct (is_nil (own_values (node_at t (fst o)))) eqn:N.
  - apply is_nil_iff in N. exists p. split; auto.
    assert (R : forall x, rename t o x = x) by (intros x; unfold rename; now rewrite no_own).
    split; [| intros v; split; apply fits_pattern_same; intros; now rewrite R].
    rewrite (map_ext _ _ R). now rewrite map_id.
  - destruct (on (node_at t (fst o))) as [q |]; [| discriminate]. injection H as <-. exists q. split; auto.
    split; [apply renamed_pattern_variables | intros; apply renamed_fits].
Qed.

(** No event is absent, and none has values of its own. *)
Definition no_absences : bool := forallb (fun d => is_nil (without d)) (nodes t).
Definition basic : bool := no_absences && forallb (fun d => is_nil (own_values d)) (nodes t).

Lemma all_nodes : forall (f : node -> bool), f nowhere = true -> forallb f (nodes t) = true ->
  forall n, f (node_at t n) = true.
Proof.
  intros f N B n. rewrite forallb_forall in B. unfold node_at.
  destruct (nth_in_or_default n (nodes t) nowhere) as [I | I]; [now apply B | now rewrite I].
Qed.

Lemma basic_own : basic = true -> forall n, own_values (node_at t n) = [].
Proof.
  intros B n. apply andb_true_iff in B as [_ B].
  now apply is_nil_iff, (all_nodes (fun d => is_nil (own_values d))).
Qed.

Lemma basic_absences : basic = true -> no_absences = true.
Proof. intros B. now apply andb_true_iff in B. Qed.

Lemma nothing_absent : no_absences = true -> forall n, without (node_at t n) = [].
Proof. intros B n. now apply is_nil_iff, (all_nodes (fun d => is_nil (without d))). Qed.

Lemma pattern_at_basic : basic = true -> forall o, pattern_at t o = on (node_at t (fst o)).
Proof. intros B o. unfold pattern_at. now rewrite basic_own. Qed.

Lemma guards_at_basic : basic = true -> forall n, guards_at t n = conditions t n.
Proof. intros B n. unfold guards_at. now rewrite basic_own. Qed.

Lemma guards_basic : basic = true -> forall ns, flat_map (guards_at t) ns = flat_map (conditions t) ns.
Proof. intros B ns. apply flat_map_ext_in. intros n _. now apply guards_at_basic. Qed.
End OwnValues.

Lemma or_iff : forall A B C D, (A <-> B) -> (C <-> D) -> (A \/ C <-> B \/ D).
Proof. tauto. Qed.

Lemma rename_guard_same : forall f g, (forall x, In x (variables g) -> f x = x) -> rename_guard f g = g.
Proof.
  intros f; induction g as [v | x | p | o l IH | l r IHl IHr | l r IHl IHr] using guard_induction; simpl;
    intros S; auto.
  - f_equal. rewrite Forall_forall in IH. transitivity (map (fun g => g) l); [| apply map_id].
    apply map_ext_in. intros g I. apply IH; auto.
    intros x X. apply S, in_flat_map; eauto.
  - rewrite IHl, IHr; auto; intros; apply S, in_app_iff; auto.
  - rewrite IHl, IHr; auto; intros; apply S, in_app_iff; auto.
Qed.

Section Differ.
Variables (t : tree) (o p : occurrence) (xs : list nat).

Lemma names_differ_variables : forall y, In y (variables (names_differ t o p xs)) <->
  exists x, In x xs /\ (y = own_name t o x \/ y = own_name t p x).
Proof.
  intros y. unfold names_differ, differ. induction xs as [| x l IH]; simpl; [firstorder |].
  rewrite IH. split.
  - intros [<- | [<- | (z & I & H)]]; [exists x | exists x | exists z]; auto.
  - intros (z & [<- | I] & [-> | ->]); auto; right; right; exists z; auto.
Qed.

Lemma names_differ_points : points (names_differ t o p xs) = [].
Proof. unfold names_differ, differ. induction xs; simpl; auto. Qed.

Lemma names_differ_holds : forall a time b time' own,
  (forall x, In x xs -> a (own_name t o x) = own o x /\ a (own_name t p x) = own p x) ->
  holds a time (names_differ t o p xs) = holds b time' (values_differ own o p xs).
Proof.
  intros a time b time' own H. unfold holds.
  replace (eval a time (names_differ t o p xs)) with (eval b time' (values_differ own o p xs)); auto.
  unfold names_differ, values_differ, differ. induction xs as [| x l IH]; auto. simpl in *.
  destruct (H x) as [-> ->]; auto. rewrite IH; auto.
Qed.
End Differ.

Lemma in_guards_at : forall t n g', In g' (guards_at t n) <->
  (exists i g, i < S (pred (times (node_at t n))) /\ In g (conditions t n) /\ g' = rename_guard (rename t (n, i)) g) \/
  (exists i j, i < j < S (pred (times (node_at t n))) /\ distinct_values (node_at t n) <> [] /\
     g' = names_differ t (n, i) (n, j) (distinct_values (node_at t n))).
Proof.
  intros t n g'. unfold guards_at. set (k := S (pred (times (node_at t n)))).
  destruct (is_nil (own_values (node_at t n))) eqn:N.
  - apply is_nil_iff in N.
    assert (R : forall i g, rename_guard (rename t (n, i)) g = g).
    { intros i g. apply rename_guard_same. intros x _. unfold rename. now rewrite no_own. }
    split.
    + intros I. left. exists 0, g'. rewrite R. repeat split; auto. unfold k; lia.
    + intros [(i & g & _ & I & ->) | (i & j & _ & D & _)]; [now rewrite R |].
      unfold own_values in N. apply app_eq_nil in N as [N _]. contradiction.
  - rewrite in_app_iff, in_flat_map.
    assert (K : forall o, In o (map (pair n) (seq 0 k)) <-> exists i, i < k /\ o = (n, i)).
    { intros o. rewrite in_map_iff. split.
      - intros (i & <- & I). apply in_seq in I. exists i; split; auto; lia.
      - intros (i & I & ->). exists i; split; auto. apply in_seq; lia. }
    apply or_iff.
    + split.
      * intros (o & I & J). apply K in I as (i & I & ->). apply in_map_iff in J as (g & <- & J). exists i, g; auto.
      * intros (i & g & I & J & ->). exists (n, i). split; [apply K; eauto | now apply in_map].
    + destruct (is_nil (distinct_values (node_at t n))) eqn:D.
      * apply is_nil_iff in D. split; [intros [] | intros (i & j & _ & H & _); contradiction].
      * split.
        -- intros I. apply in_flat_map in I as (o & I & J). apply in_flat_map in J as (p & J & L).
           apply K in I as (i & I & ->). apply K in J as (j & J & ->). simpl in L.
           destruct (i <? j) eqn:Q; [| destruct L]. apply Nat.ltb_lt in Q. destruct L as [<- | []].
           exists i, j. repeat split; auto. intros H. rewrite H in D. discriminate.
        -- intros (i & j & [I J] & _ & ->). apply in_flat_map. exists (n, i).
           split; [apply K; exists i; split; auto; lia |]. apply in_flat_map. exists (n, j).
           split; [apply K; exists j; auto |]. simpl. rewrite (proj2 (Nat.ltb_lt _ _) I). simpl; auto.
Qed.

(** ** The test *)

Section Test.
Variable t : tree.
Variable guards : list guard.
Variable part : nat -> list occurrence.

Definition observed (o : occurrence) (e : event) : list (binding nat) :=
  if late e then []
  else match pattern_at t o with Some p => bindings p (content e) | None => [] end.

Fixpoint unions (m : assigned event) : list (binding nat) :=
  match m with
  | [] => [[]]
  | (o, e) :: m => match observed o e with [] => [] | found => joined found (unions m) end
  end.

Definition bound_variables (m : assigned event) : list nat :=
  flat_map (fun o => match pattern_at t o with Some p => pattern_variables p | None => [] end) (domain m).

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
Hypothesis guards_iff : forall g, In g guards <-> exists n, In n (map fst r) /\ In g (guards_at t n).

(** An event fits an occurrence, and a guard is known, under one assignment of all variables. *)
Definition fits_at (a : nat -> value) (o : occurrence) (e : event) : Prop :=
  late e = false /\ exists p, pattern_at t o = Some p /\ fits_pattern a p (content e).

Definition IsKnown (m : assigned event) (g : guard) : Prop :=
  (forall x, In x (variables g) ->
     exists o p, In o (domain m) /\ pattern_at t o = Some p /\ In x (pattern_variables p)) /\
  (forall p, In p (points g) ->
     match p with
     | At n => In (n, 0) (domain m)
     | Start n | End n => forall o, InPart t r n o -> In o (domain m)
     end).

Lemma member_iff : forall x l, member x l = true <-> In x l.
Proof.
  unfold member; intros; rewrite existsb_exists; split.
  - intros (y & I & Q). apply Nat.eqb_eq in Q; subst; auto.
  - intros I; exists x; split; auto. apply Nat.eqb_refl.
Qed.

Lemma known_iff : forall m g, known m g = true <-> IsKnown m g.
Proof.
  intros m g; unfold known, IsKnown. rewrite andb_true_iff, !forallb_forall.
  assert (B : forall x, In x (bound_variables m) <->
    exists o p, In o (domain m) /\ pattern_at t o = Some p /\ In x (pattern_variables p)).
  { intros x; unfold bound_variables; rewrite in_flat_map. split.
    - intros (o & I & J). destruct (pattern_at t o) as [p |] eqn:P; [| destruct J]. exists o, p; auto.
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

Lemma observed_iff : forall a o e, fits_at a o e <-> exists bs, In bs (observed o e) /\ respects a bs.
Proof.
  intros a o e; unfold fits_at, observed.
  destruct (late e); [split; [intros [? _]; discriminate | intros (bs & [] & _)] |].
  destruct (pattern_at t o) as [p |].
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
  fits_at a o e) <-> exists bs, In bs (unions m) /\ respects a bs.
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
  unfold observed in I. destruct (late e); [destruct I |]. destruct (pattern_at t o); [| destruct J].
  eapply bindings_variables; eauto.
Qed.

(** [m] is consistent under one assignment of the variables. *)
Definition Under (a : nat -> value) (m : assigned event) : Prop :=
  (forall o e, In (o, e) m -> fits_at a o e) /\
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

(** The name of a variable is bound when an event gives the variable a value. *)
Lemma name_bound : forall m o x, x < fresh t ->
  ((exists p q, In p (domain m) /\ pattern_at t p = Some q /\ In (rename t o x) (pattern_variables q)) <->
   exists p, GivesValue t m p o x).
Proof.
  intros m o x L. split.
  - intros (p & q & I & P & J). destruct (pattern_at_iff t (fun _ => Null) p q P) as (w & O & V & _).
    rewrite V in J. apply in_map_iff in J as (y & Q & J).
    assert (M : y < fresh t) by (apply (in_names t (fst p)); unfold names_at; rewrite O; apply in_app_iff; auto).
    symmetry in Q. apply rename_one in Q as [<- Q]; auto. exists p. repeat split; eauto.
  - intros (p & I & (w & O & J) & H).
    assert (P : exists q, pattern_at t p = Some q).
    { unfold pattern_at. rewrite O. destruct (is_nil _); simpl; eauto. }
    destruct P as [q P]. exists p, q. repeat split; auto.
    destruct (pattern_at_iff t (fun _ => Null) p q P) as (w' & O' & V & _). rewrite O in O'. injection O' as <-.
    rewrite V. apply in_map_iff. exists x. split; auto. symmetry. now apply rename_one.
Qed.

Lemma condition_names : forall n g x, In g (conditions t n) -> In x (variables g) -> x < fresh t.
Proof.
  intros n g x I J. apply (in_names t n). unfold names_at. apply in_app_iff; right. apply in_app_iff; left.
  apply in_flat_map; eauto.
Qed.

Lemma renamed_known : forall m o g, In g (conditions t (fst o)) ->
  (IsKnown m (rename_guard (rename t o) g) <-> Known t r m o g).
Proof.
  intros m o g I. unfold IsKnown, Known. rewrite renamed_variables, renamed_points.
  assert (V : (forall y, In y (map (rename t o) (variables g)) ->
      exists p q, In p (domain m) /\ pattern_at t p = Some q /\ In y (pattern_variables q)) <->
    (forall x, In x (variables g) -> exists p, GivesValue t m p o x)).
  { split.
    - intros H x X. apply name_bound; [eapply condition_names; eauto |]. now apply H, in_map.
    - intros H y Y. apply in_map_iff in Y as (x & <- & X). apply name_bound; auto. eapply condition_names; eauto. }
  rewrite V. reflexivity.
Qed.

Lemma differ_known : forall m o p xs, is_own t o = is_own t p ->
  (forall x, In x xs -> is_own t o x = true /\ x < fresh t) ->
  (IsKnown m (names_differ t o p xs) <-> forall x, In x xs -> GivesValue t m o o x /\ GivesValue t m p p x).
Proof.
  intros m o p xs S W. unfold IsKnown. rewrite names_differ_points.
  assert (N : forall q x, In x xs -> is_own t q = is_own t o ->
    ((exists y w, In y (domain m) /\ pattern_at t y = Some w /\ In (own_name t q x) (pattern_variables w)) <->
     GivesValue t m q q x)).
  { intros q x I Q. destruct (W x I) as [O L]. rewrite <- Q in O.
    replace (own_name t q x) with (rename t q x) by (unfold rename; now rewrite O). rewrite name_bound by auto.
    split; [intros (y & B) | eauto]. assert (B' := B). destruct B' as (_ & _ & H). rewrite O in H. now subst. }
  split.
  - intros [H _] x I. split; apply N; auto; apply H, names_differ_variables; eauto.
  - intros H. split; [| intros ? []]. intros y Y. apply names_differ_variables in Y as (x & I & [-> | ->]);
      apply N; auto; now apply H.
Qed.

(** The assignment of all variables by their names, and those of the definition. *)
Theorem under_names : forall m, NoDup (domain m) ->
  (forall o, In o (domain m) -> snd o < times (node_at t (fst o))) ->
  (forall a, Under a m -> ConsistentUnder t r m a (fun o x => a (own_name t o x))) /\
  (forall a own, ConsistentUnder t r m a own -> Under (named_values t a own) m).
Proof.
  intros m N W. unfold Under, ConsistentUnder.
  assert (T : forall time, (forall p z, time p = Some z <-> IsTime t r m p z) -> forall p, time p = time_at part m p).
  { intros time H p. destruct (time_at part m p) as [z |] eqn:Q.
    - apply H, (time_at_iff t r m part); auto.
    - destruct (time p) as [z |] eqn:R; auto. apply H, (time_at_iff t r m part) in R; auto. congruence. }
  assert (F : forall a' a own o e, (forall x, x < fresh t -> a' (rename t o x) = values_for t a own o x) ->
    (fits_at a' o e <-> Fits t (values_for t a own o) o e)).
  { intros a' a own o e S. unfold fits_at, Fits. split; intros (L & p & P & H); (split; [auto |]).
    - destruct (pattern_at_iff t a' o p P) as (q & O & V & E). exists q; split; auto. apply E in H.
      revert H. apply fits_pattern_same. intros x X. apply S. apply (in_names t (fst o)). unfold names_at. rewrite O.
      apply in_app_iff; auto.
    - assert (P' : exists q, pattern_at t o = Some q).
      { unfold pattern_at. rewrite P. destruct (is_nil _); simpl; eauto. }
      destruct P' as [q P']. exists q; split; auto.
      destruct (pattern_at_iff t a' o q P') as (q' & O & V & E). rewrite P in O. injection O as <-. apply E.
      revert H. apply fits_pattern_same. intros x X. symmetry. apply S. apply (in_names t (fst o)). unfold names_at.
      rewrite P. apply in_app_iff; auto. }
  assert (G : forall a' a own time o g, In g (conditions t (fst o)) ->
    (forall x, x < fresh t -> a' (rename t o x) = values_for t a own o x) ->
    holds a' time (rename_guard (rename t o) g) = holds (values_for t a own o) time g).
  { intros a' a own time o g I S. rewrite renamed_holds. apply holds_same; auto. intros x X. apply S.
    eapply condition_names; eauto. }
  assert (D : forall n x, In x (distinct_values (node_at t n)) -> forall i, is_own t (n, i) x = true /\ x < fresh t).
  { intros n x I i. split.
    - unfold is_own, own_values. simpl. apply existsb_exists. exists x. split; [apply in_app_iff; auto |].
      apply Nat.eqb_refl.
    - apply (in_names t n). unfold names_at. apply in_app_iff; right. apply in_app_iff; auto. }
  split.
  - intros a' (FA & GA). exists (time_at part m).
    assert (SAME : forall o x, x < fresh t -> a' (rename t o x) = values_for t a' (fun o x => a' (own_name t o x)) o x).
    { intros o x _. unfold rename, values_for. destruct (is_own t o x); auto. }
    split; [| split; [| split]].
    + intros o e I. apply (F a'); auto.
    + intros; now apply time_at_iff.
    + intros o g I J K. rewrite <- (G a') by auto.
      assert (B : snd o < S (pred (times (node_at t (fst o)))) \/ forall x, In x (variables g) -> is_own t o x = false).
      { destruct (le_lt_dec (times (node_at t (fst o))) (snd o)) as [Q | Q]; [right | left; lia].
        intros x X. destruct (is_own t o x) eqn:O; auto. exfalso. destruct K as [K _].
        destruct (K x X) as (p & M & _ & H). rewrite O in H. subst. apply W in M. lia. }
      destruct B as [B | B].
      * apply GA; [| apply known_iff; now apply renamed_known]. apply guards_iff. exists (fst o). split; auto.
        apply in_guards_at. left. exists (snd o), g. rewrite <- surjective_pairing. auto.
      * assert (Q : rename_guard (rename t o) g = rename_guard (rename t (fst o, 0)) g).
        { rewrite !rename_guard_same; auto; intros x X; unfold rename; [| now rewrite B].
          replace (is_own t (fst o, 0) x) with (is_own t o x) by reflexivity. now rewrite B. }
        rewrite <- (renamed_known m o g J) in K. rewrite Q in *.
        apply GA; [| now apply known_iff]. apply guards_iff. exists (fst o). split; auto.
        apply in_guards_at. left. exists 0, g. repeat split; auto. lia.
    + intros n i j L R NE K.
      rewrite <- (names_differ_holds t (n, i) (n, j) _ a' (time_at part m)) by auto.
      apply GA.
      * apply guards_iff. exists n. split; auto. apply in_guards_at. right. exists i, j. repeat split; auto.
        destruct (distinct_values (node_at t n)) as [| x l]; [congruence |].
        destruct (K x) as [_ (M & _)]; [simpl; auto |]. apply W in M. simpl in M. lia.
      * apply known_iff, differ_known; auto.
  - intros a own (time & FA & C & GA & DA). split.
    + intros o e I. apply (F _ a own); auto. intros; now apply named_under.
    + intros g J K. apply guards_iff in J as (n & I & J). apply known_iff in K.
      assert (X : forall o, fst o = n -> forall g0, In g0 (conditions t n) -> 
        holds (named_values t a own) (time_at part m) (rename_guard (rename t o) g0) =
        holds (values_for t a own o) time g0).
      { intros o <- g0 J0. rewrite (G _ a own); auto; [| intros; now apply named_under].
        apply holds_same; auto. intros; symmetry; now apply T. }
      apply in_guards_at in J as [(i & g0 & _ & J & ->) | (i & j & [L _] & NE & ->)].
      * rewrite X by auto. apply GA; auto. now apply renamed_known in K.
      * rewrite (names_differ_holds t (n, i) (n, j) _ _ _ a time own).
        -- apply DA; auto. apply differ_known; auto.
        -- intros x Y. destruct (D n x Y i) as [_ Z]. now rewrite !named_own.
Qed.

Theorem consistent_iff : forall m, NoDup (domain m) ->
  (forall o, In o (domain m) -> snd o < times (node_at t (fst o))) ->
  (consistent m = true <-> Consistent t r m).
Proof.
  intros m N W. rewrite consistent_under. destruct (under_names m N W) as [A B].
  split; [intros (a & H); eexists; eexists; eauto | intros (a & own & H); eauto].
Qed.

Lemma is_known_basic : forall m o g, basic t = true -> (Known t r m o g <-> IsKnown m g).
Proof.
  intros m o g B. unfold Known, IsKnown.
  assert (V : forall x, (exists p, GivesValue t m p o x) <->
    exists p q, In p (domain m) /\ pattern_at t p = Some q /\ In x (pattern_variables q)).
  { intros x. split.
    - intros (p & I & (q & O & J) & _). exists p, q. rewrite pattern_at_basic; auto.
    - intros (p & q & I & O & J). exists p. rewrite pattern_at_basic in O by auto.
      assert (N : forall p, is_own t p x = false) by (intros; now apply no_own, basic_own).
      repeat split; eauto. now rewrite !N. }
  split; intros [X Y]; (split; [intros x J; now apply V, X | auto]).
Qed.

(** In a tree without values of one's own there is one assignment. *)
Theorem consistent_basic : forall m, basic t = true -> (Consistent t r m <-> exists a time,
  (forall o e, In (o, e) m -> Fits t a o e) /\
  (forall p z, time p = Some z <-> IsTime t r m p z) /\
  (forall n g, In n (map fst r) -> In g (conditions t n) -> IsKnown m g -> holds a time g = true)).
Proof.
  intros m B. assert (O := basic_own t B).
  assert (U : forall a own o x, values_for t a own o x = a x) by (intros; unfold values_for; now rewrite no_own).
  assert (F : forall a own o e, Fits t (values_for t a own o) o e <-> Fits t a o e).
  { intros a own o e. unfold Fits. split; intros (L & p & P & H); (split; [auto |]); exists p; (split; [auto |]);
      (revert H; apply fits_pattern_same; intros; now rewrite U). }
  split.
  - intros (a & own & time & FA & T & G & _). exists a, time. split; [| split; [auto |]].
    + intros o e I. eapply F; eauto.
    + intros n g I J K. rewrite <- (G (n, 0) g); auto; [apply holds_same; auto | now apply is_known_basic].
  - intros (a & time & FA & T & G). exists a, (fun _ _ => Null), time. split; [| split; [auto | split]].
    + intros o e I. apply F; auto.
    + intros o g I J K. rewrite <- (G (fst o) g); auto; [apply holds_same; auto | now apply is_known_basic in K].
    + intros n i j _ _ D. exfalso. apply D. specialize (O n). now apply app_eq_nil in O as [O _].
Qed.

Lemma time_at_same : forall m m' p, (forall o, In o (asked_by part p) -> time_seen m o = time_seen m' o) ->
  time_at part m p = time_at part m' p.
Proof.
  intros m m' [n | n | n] H; simpl in *; [apply H; auto | |]; unfold extreme_time;
    erewrite map_ext_in; eauto.
Qed.

Lemma known_same : forall m m' g, (forall o, In o (domain m) <-> In o (domain m')) -> known m g = known m' g.
Proof.
  intros m m' g D. apply eq_true_iff_eq. rewrite !known_iff. unfold IsKnown.
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
