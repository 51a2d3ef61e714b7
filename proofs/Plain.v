(** * Plain scenarios: each occurrence has one predicate on events

    The scenarios of a tree without variables and time points.  Predicates are numbered; number 0 is
    relevance.  A detection is then a run through the sets of occurrences that are done, which is what
    the translations into automata, LTLf and RML are proved against. *)

Require Import List Bool Arith Lia Permutation.
Require Import RVAFT.Language RVAFT.Definition RVAFT.Search.
Import ListNotations.

(** The number of the predicate "the event is relevant". *)
Definition relevance : nat := 0.

(** A plain scenario: its occurrences, their precedence, and the predicate that each requires. *)
Record shape := Shape {
  shape_occurrences : list occurrence;
  shape_before : occurrence -> occurrence -> bool;
  requirement : occurrence -> nat }.

(** An occurrence is ready when it is not done, and all before it are. *)
Definition ready (x : shape) (done : list occurrence) (o : occurrence) : bool :=
  negb (among o done) && forallb (fun p => implb (shape_before x p o) (among p done)) (shape_occurrences x).

Definition finished (x : shape) (done : list occurrence) : bool :=
  forallb (fun o => among o done) (shape_occurrences x).

Section Plain.
Context {E : Type}.
Variable satisfies : nat -> E -> bool.

Definition relevant (e : E) : bool := satisfies relevance e.
Notation Rel := (fun e => relevant e = true).

Definition plain (x : shape) : plan E :=
  Plan (shape_occurrences x) (shape_before x)
       (fun m => forallb (fun y => satisfies (requirement x (fst y)) (snd y)) m).

Lemma plain_lawful : forall x, lawful (plain x).
Proof.
  intros x; constructor; simpl.
  - intros m m' _ P H. rewrite forallb_forall in *. intros y I. apply H.
    now apply (Permutation_in _ (Permutation_sym P)).
  - intros y m _ H. now apply andb_true_iff in H.
Qed.

Lemma all_lawful : forall xs, Forall lawful (map plain xs).
Proof. intros xs; apply Forall_forall; intros c I. apply in_map_iff in I as (x & <- & _). apply plain_lawful. Qed.

(** ** A detection as a run through done sets *)

(** Whether a match may leave out the event, and whether it may use it. *)
Definition skips (s : semantics) (e : E) : bool :=
  match s with Strict => false | Projected | Consecutive => negb (relevant e) | Scattered => true end.
Definition counts (s : semantics) (e : E) : bool :=
  match s with Strict | Scattered => true | Projected | Consecutive => relevant e end.

(** From the done set, the trace completes the scenario. *)
Inductive Completes (s : semantics) (x : shape) : list occurrence -> list E -> Prop :=
| completed : forall done u, finished x done = true -> Completes s x done u
| skipped : forall done e u, skips s e = true -> Completes s x done u -> Completes s x done (e :: u)
| served : forall done e u o, counts s e = true -> In o (shape_occurrences x) -> ready x done o = true ->
    satisfies (requirement x o) e = true -> Completes s x (o :: done) u -> Completes s x done (e :: u).

Lemma full_finished : forall x m, full (plain x) m = finished x (domain m).
Proof. reflexivity. Qed.

Lemma in_extend_plain : forall x e m m', plan_consistent (plain x) m = true ->
  (In m' (extend (plain x) e m) <-> exists o, m' = (o, e) :: m /\ In o (shape_occurrences x) /\
     ready x (domain m) o = true /\ satisfies (requirement x o) e = true).
Proof.
  intros x e m m' K. rewrite (in_extend relevant). simpl in *. split.
  - intros (o & -> & I & N & D & C). exists o; repeat split; auto.
    + unfold ready. rewrite andb_true_iff, negb_true_iff, forallb_forall. split.
      * apply not_true_is_false. now rewrite among_iff.
      * intros p J. destruct (shape_before x p o) eqn:B; simpl; auto. apply among_iff; auto.
    + now apply andb_true_iff in C.
  - intros (o & -> & I & R & S). unfold ready in R. rewrite andb_true_iff, negb_true_iff, forallb_forall in R.
    destruct R as [N D]. exists o; repeat split; auto.
    + rewrite <- among_iff, N. discriminate.
    + intros p J B. specialize (D p J). rewrite B in D. now apply among_iff.
    + simpl. rewrite S. exact K.
Qed.

Definition Consistents x (l : list (assigned E)) : Prop := forall m, In m l -> plan_consistent (plain x) m = true.

Lemma step_consistent : forall s x e l, Consistents x l -> Consistents x (step relevant s (plain x) e l).
Proof.
  intros s x e l C.
  assert (N : Consistents x (flat_map (extend (plain x) e) l)).
  { intros m I. apply in_flat_map in I as (m0 & _ & I). apply (in_extend relevant) in I as (o & -> & _ & _ & _ & K).
    exact K. }
  intros m I. destruct s; unfold step in I; [| destruct (relevant e) | destruct (relevant e) |]; auto.
  - apply in_app_iff in I as [I | I]; auto. apply in_start in I as [-> _]; auto.
  - apply in_app_iff in I as [I | I]; auto.
Qed.

(** The members of a step of the search, for plain scenarios. *)
Lemma in_step_plain : forall s x e l m', Consistents x l ->
  (In m' (step relevant s (plain x) e l) <->
   (In m' l /\ skips s e = true) \/ (s = Consecutive /\ relevant e = true /\ m' = []) \/
   (counts s e = true /\ exists m o, In m l /\ m' = (o, e) :: m /\ In o (shape_occurrences x) /\
      ready x (domain m) o = true /\ satisfies (requirement x o) e = true)).
Proof.
  intros s x e l m' C.
  assert (N : In m' (flat_map (extend (plain x) e) l) <-> exists m o, In m l /\ m' = (o, e) :: m /\
     In o (shape_occurrences x) /\ ready x (domain m) o = true /\ satisfies (requirement x o) e = true).
  { rewrite in_flat_map. split.
    - intros (m & I & J). apply in_extend_plain in J as (o & J); auto. exists m, o; auto.
    - intros (m & o & I & J). exists m; split; auto. apply in_extend_plain; eauto. }
  destruct s; unfold step, skips, counts;
    [| destruct (relevant e) | destruct (relevant e) |]; simpl negb; rewrite ?in_app_iff, ?in_start, ?N;
    intuition (try discriminate).
  all: subst; auto.
Qed.

Definition Reaches s x l u :=
  exists w v, u = w ++ v /\ existsb (full (plain x)) (fold_left (fun l e => step relevant s (plain x) e l) w l) = true.

Lemma reaches_cons : forall s x l e u,
  Reaches s x l (e :: u) <-> existsb (full (plain x)) l = true \/ Reaches s x (step relevant s (plain x) e l) u.
Proof.
  intros; split.
  - intros ([| f w] & v & Q & F); [left; exact F |]. injection Q as <- ->. right. exists w, v; auto.
  - intros [F | (w & v & -> & F)]; [exists [], (e :: u); auto | exists (e :: w), v; auto].
Qed.

Lemma reaches_completes : forall s x u l, Consistents x l -> (s = Consecutive -> In [] l) ->
  (Reaches s x l u <-> exists m v w, In m l /\ u = v ++ w /\ Completes s x (domain m) w /\
                         (v = [] \/ (s = Consecutive /\ m = []))).
Proof.
  intros s x u; induction u as [| e u IH]; intros l C Z.
  - split.
    + intros (w & v & Q & F). symmetry in Q; apply app_eq_nil in Q as [-> ->]. apply existsb_exists in F as (m & I & F).
      exists m, [], []; repeat split; auto. now constructor.
    + intros (m & v & w & I & Q & K & _). symmetry in Q; apply app_eq_nil in Q as [-> ->].
      inversion K; subst. exists [], []; split; auto.
      apply existsb_exists. exists m; auto.
  - rewrite reaches_cons.
    assert (C' := step_consistent s x e l C).
    assert (Z' : s = Consecutive -> In [] (step relevant s (plain x) e l)).
    { intros Q. apply in_step_plain; auto. subst s. simpl. destruct (relevant e); auto. }
    rewrite IH by auto. split.
    + intros [F | (m' & v & w & I & -> & K & V)].
      * apply existsb_exists in F as (m & I & F). exists m, [], (e :: u); repeat split; auto. now constructor.
      * destruct V as [-> | [Q ->]].
        -- apply in_step_plain in I as [[I S] | [(Q & R & ->) | (N & m & o & I & -> & O & R & S)]]; auto.
           ++ exists m', [], (e :: w); repeat split; auto. now constructor 2.
           ++ exists [], [e], w; repeat split; auto.
           ++ exists m, [], (e :: w); repeat split; auto. now apply served with o.
        -- exists [], (e :: v), w; repeat split; auto.
    + intros (m & v & w & I & Q & K & V). destruct v as [| f v].
      * simpl in Q; subst w. inversion K as [d u' F | d f u' S K' | d f u' o N O R S K']; subst.
        -- left. apply existsb_exists; exists m; auto.
        -- right. exists m, [], u; repeat split; auto. apply in_step_plain; auto.
        -- right. exists ((o, e) :: m), [], u; repeat split; auto. apply in_step_plain; auto. right; right; split; auto.
           exists m, o; auto.
      * injection Q as <- ->. destruct V as [V | [Q ->]]; [discriminate |]. right. exists [], v, w; repeat split; auto.
Qed.

Notation Detected s xs := (Detected Rel (Scenarios (map plain xs)) s).

(** A trace is detected when it completes a scenario from nothing done; under [consecutive], when it
    does so from some position on. *)
Theorem detected_completes : forall s xs u, Detected s xs u <->
  exists x v w, In x xs /\ u = v ++ w /\ (v = [] \/ s = Consecutive) /\ Completes s x [] w.
Proof.
  intros s xs u. rewrite detected_states by apply all_lawful.
  assert (C : forall x, Consistents x [[]]) by (intros x m [<- | []]; auto).
  assert (Z : s = Consecutive -> In [] [([] : assigned E)]) by (simpl; auto).
  split.
  - intros (w & v & c & -> & I & F). apply in_map_iff in I as (x & <- & I).
    assert (R : Reaches s x [[]] (w ++ v)) by (exists w, v; auto).
    apply reaches_completes in R as (m & v' & w' & [<- | []] & Q & K & V); auto. exists x, v', w'.
    split; [exact I | split; [exact Q | split; [tauto | exact K]]].
  - intros (x & v & w & I & -> & V & K).
    assert (R : Reaches s x [[]] (v ++ w)).
    { apply reaches_completes; auto. exists [], v, w. simpl. intuition auto. }
    destruct R as (w' & v' & Q & F). exists w', v', (plain x). repeat split; auto. now apply in_map.
Qed.

(** Detection under the other two semantics is that under [strict], on the relevant events. *)
Lemma completes_filter : forall s x, s = Projected \/ s = Consecutive -> forall u done,
  Completes s x done u <-> Completes Strict x done (filter relevant u).
Proof.
  intros s x S; induction u as [| e u IH]; intros done; simpl.
  - split; intros K; inversion K; now constructor.
  - assert (SK : skips s e = negb (relevant e)) by (destruct S as [-> | ->]; auto).
    assert (CO : counts s e = relevant e) by (destruct S as [-> | ->]; auto).
    destruct (relevant e); simpl in *; split; intros K.
    + inversion K; subst; try congruence; [now constructor |]. apply served with o; auto. now apply IH.
    + inversion K; subst; try discriminate; [now constructor |]. apply served with o; auto. now apply IH.
    + apply IH. inversion K; subst; try congruence; auto. now constructor.
    + apply skipped; auto. now apply IH.
Qed.

Theorem detected_projected : forall xs u, Detected Projected xs u <-> Detected Strict xs (filter relevant u).
Proof.
  intros; rewrite !detected_completes. split.
  - intros (x & v & w & I & -> & [-> | Q] & K); [| discriminate].
    exists x, [], (filter relevant w). rewrite <- completes_filter with (s := Projected); auto.
  - intros (x & v & w & I & Q & [-> | Z] & K); [| discriminate]. simpl in Q; subst w.
    exists x, [], u. rewrite completes_filter; auto.
Qed.

Theorem detected_consecutive : forall xs u, Detected Consecutive xs u <-> exists v w, u = v ++ w /\
  Detected Projected xs w.
Proof.
  intros xs u. rewrite detected_completes. split.
  - intros (x & v & w & I & -> & _ & K). exists v, w; split; auto. apply detected_completes. exists x, [], w.
    rewrite completes_filter in *; auto.
  - intros (v & w & -> & D). apply detected_completes in D as (x & v' & w' & I & -> & [-> | Q] & K); [| discriminate].
    exists x, v, w'. rewrite completes_filter in *; auto.
Qed.

(** What is done matters as a set of the occurrences of the scenario. *)
Definition agree (x : shape) (d d' : list occurrence) : Prop :=
  forall p, In p (shape_occurrences x) -> (In p d <-> In p d').

Lemma agree_among : forall x d d' p, agree x d d' -> In p (shape_occurrences x) -> among p d = among p d'.
Proof. intros x d d' p H I; apply eq_true_iff_eq; rewrite !among_iff; auto. Qed.

Lemma forallb_ext_in : forall (A : Type) (f g : A -> bool) l, (forall a, In a l -> f a = g a) ->
  forallb f l = forallb g l.
Proof. induction l; simpl; intros H; auto. rewrite H, IHl; auto. Qed.

Lemma ready_agree : forall x d d' o, agree x d d' -> In o (shape_occurrences x) -> ready x d o = ready x d' o.
Proof.
  intros x d d' o H I. unfold ready. rewrite (agree_among x d d' o) by auto. f_equal.
  apply forallb_ext_in. intros p J. now rewrite (agree_among x d d' p).
Qed.

Lemma finished_agree : forall x d d', agree x d d' -> finished x d = finished x d'.
Proof. intros x d d' H. apply forallb_ext_in. intros p J. now apply agree_among with x. Qed.

Lemma completes_agree : forall s x d d' u, agree x d d' -> Completes s x d u -> Completes s x d' u.
Proof.
  intros s x d d' u H K; revert d' H.
  induction K as [d u F | d e u S K IH | d e u o N I R S K IH]; intros d' H.
  - constructor. now rewrite <- (finished_agree x d).
  - constructor 2; auto.
  - apply served with o; auto; [now rewrite <- (ready_agree x d) |]. apply IH. intros p J; simpl. now rewrite (H p J).
Qed.

(** Completion does not end when the trace goes on. *)
Lemma completes_app : forall s x d u v, Completes s x d u -> Completes s x d (u ++ v).
Proof.
  intros s x d u v K; induction K; simpl; [now constructor | now constructor 2 | now apply served with o].
Qed.
End Plain.
