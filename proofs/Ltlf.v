(** * LTL on finite traces: the texts that are emitted, and why they mean the tree

    Syntax and semantics of the fragment (strong next [X[!]], [F], [U]); the sum over sets of done
    occurrences; the short texts of [sand], [and] and votes over leaves.  Each text is proved for
    [strict] or [scattered]; the text of [projected] and [consecutive] is that of [strict] with every
    step taken to the next relevant position. *)

Require Import List Bool Arith Lia.
Require Import RVAFT.Language RVAFT.Definition RVAFT.Search RVAFT.Plain RVAFT.Acceptance.
Import ListNotations.

(** ** Syntax and semantics *)

Inductive formula :=
| Truth
| Falsity
| Atom (p : nat)
| Neg (f : formula)
| Conj (f g : formula)
| Disj (f g : formula)
| Next (f : formula)                    (* strong: there is a next position *)
| Eventually (f : formula)
| Until (f g : formula).

(** The operators that Spot's syntax has beside these. *)
Definition weak_next (f : formula) : formula := Neg (Next (Neg f)).
Definition always (f : formula) : formula := Neg (Eventually (Neg f)).
Definition release (f g : formula) : formula := Neg (Until (Neg f) (Neg g)).

Section Semantics.
Context {E : Type}.
Variable satisfies : nat -> E -> bool.

(** The formula holds at the first position of the trace. *)
Fixpoint holds (f : formula) (u : list E) {struct f} : bool :=
  match f with
  | Truth => true
  | Falsity => false
  | Atom p => match u with e :: _ => satisfies p e | [] => false end
  | Neg f => negb (holds f u)
  | Conj f g => holds f u && holds g u
  | Disj f g => holds f u || holds g u
  | Next f => match u with _ :: v => negb (is_nil v) && holds f v | [] => false end
  | Eventually f => (fix later u := match u with [] => false | _ :: v => holds f u || later v end) u
  | Until f g => (fix until u := match u with [] => false | _ :: v => holds g u || (holds f u && until v) end) u
  end.

Lemma holds_next : forall f e u, holds (Next f) (e :: u) = true <-> u <> [] /\ holds f u = true.
Proof. intros f e [| e' u]; simpl; split; try discriminate; intuition congruence. Qed.

(** [F f]: at some position. *)
Lemma holds_eventually : forall f u, holds (Eventually f) u = true <->
  exists v w, u = v ++ w /\ w <> [] /\ holds f w = true.
Proof.
  intros f; induction u as [| e u IH].
  - split; [discriminate |]. intros (v & w & Q & N & _). symmetry in Q; apply app_eq_nil in Q as [_ ->]. congruence.
  - change (holds (Eventually f) (e :: u)) with (holds f (e :: u) || holds (Eventually f) u).
    rewrite orb_true_iff, IH. split.
    + intros [H | (v & w & -> & N & H)]; [exists [], (e :: u) | exists (e :: v), w]; repeat split; auto; discriminate.
    + intros ([| a v] & w & Q & N & H); [left; simpl in Q; congruence |]. injection Q as <- ->. right; eauto.
Qed.

(** [f U g]: [g] at some position, and [f] at all positions before it. *)
Lemma holds_until : forall f g u, holds (Until f g) u = true <->
  exists v w, u = v ++ w /\ w <> [] /\ holds g w = true /\
    forall v1 v2, v = v1 ++ v2 -> v2 <> [] -> holds f (v2 ++ w) = true.
Proof.
  intros f g; induction u as [| e u IH].
  - split; [discriminate |]. intros (v & w & Q & N & _). symmetry in Q; apply app_eq_nil in Q as [_ ->]. congruence.
  - change (holds (Until f g) (e :: u)) with (holds g (e :: u) || (holds f (e :: u) && holds (Until f g) u)).
    rewrite orb_true_iff, andb_true_iff, IH. split.
    + intros [H | [F (v & w & -> & N & G & A)]].
      * exists [], (e :: u); repeat split; auto; try discriminate. intros v1 v2 Q N.
        symmetry in Q; apply app_eq_nil in Q as [_ ->]. congruence.
      * exists (e :: v), w; repeat split; auto. intros [| a v1] v2 Q N2; simpl in Q; [subst v2; exact F |].
        injection Q as <- ->. eauto.
    + intros ([| a v] & w & Q & N & G & A); [left; simpl in Q; congruence |]. injection Q as <- ->. right. split.
      * apply (A [] (e :: v)); auto; discriminate.
      * exists v, w; repeat split; auto. intros v1 v2 -> N2. apply (A (e :: v1)); auto.
Qed.

(** ** Junctions, without neutral elements *)

Definition conjoin (f g : formula) : formula :=
  match f, g with
  | Truth, h | h, Truth => h
  | Falsity, _ | _, Falsity => Falsity
  | _, _ => Conj f g
  end.

Definition disjoin (f g : formula) : formula :=
  match f, g with
  | Falsity, h | h, Falsity => h
  | Truth, _ | _, Truth => Truth
  | _, _ => Disj f g
  end.

Definition conjunction (l : list formula) : formula := fold_right conjoin Truth l.
Definition disjunction (l : list formula) : formula := fold_right disjoin Falsity l.

Lemma holds_conjoin : forall f g u, holds (conjoin f g) u = holds f u && holds g u.
Proof.
  intros f g u; destruct f, g; simpl; auto;
    repeat match goal with |- context [?b && true] => rewrite andb_true_r
      | |- context [?b && false] => rewrite andb_false_r end; auto.
Qed.

Lemma holds_disjoin : forall f g u, holds (disjoin f g) u = holds f u || holds g u.
Proof.
  intros f g u; destruct f, g; simpl; auto;
    repeat match goal with |- context [?b || true] => rewrite orb_true_r
      | |- context [?b || false] => rewrite orb_false_r end; auto.
Qed.

Lemma holds_conjunction : forall l u, holds (conjunction l) u = forallb (fun f => holds f u) l.
Proof. induction l; simpl; intros; auto. now rewrite holds_conjoin, IHl. Qed.

Lemma holds_disjunction : forall l u, holds (disjunction l) u = existsb (fun f => holds f u) l.
Proof. induction l; simpl; intros; auto. now rewrite holds_disjoin, IHl. Qed.

(** ** From [strict] to [projected] and [consecutive] *)

Notation relevant := (relevant satisfies).
Notation Rel := (fun e => relevant e = true).
Notation plain := (plain satisfies).
Notation Detected s xs := (Detected Rel (Scenarios (map plain xs)) s).
Notation Completes := (Completes satisfies).

(** [!rel U (rel & f)]: [f] at the next relevant position, which may be this one. *)
Definition at_relevant (f : formula) : formula := Until (Neg (Atom relevance)) (Conj (Atom relevance) f).

(** Every step goes to the next relevant position. *)
Fixpoint relativised (f : formula) : formula :=
  match f with
  | Next f => Next (at_relevant (relativised f))
  | Neg f => Neg (relativised f)
  | Conj f g => Conj (relativised f) (relativised g)
  | Disj f g => Disj (relativised f) (relativised g)
  | Truth | Falsity | Atom _ | Eventually _ | Until _ _ => f
  end.

Fixpoint bounded (f : formula) : bool :=
  match f with
  | Truth | Falsity | Atom _ => true
  | Neg f | Next f => bounded f
  | Conj f g | Disj f g => bounded f && bounded g
  | Eventually _ | Until _ _ => false
  end.

(** The text under a semantics, from the formula of [strict] (or of [scattered]). *)
Definition text_of (s : semantics) (f : formula) : formula :=
  match s with
  | Strict | Scattered => f
  | Projected => at_relevant (relativised f)
  | Consecutive => Eventually (Conj (Atom relevance) (relativised f))
  end.

Lemma at_relevant_cons : forall f e u,
  holds (at_relevant f) (e :: u) = if relevant e then holds f (e :: u) else holds (at_relevant f) u.
Proof.
  intros f e u. change (holds (at_relevant f) (e :: u)) with
    ((relevant e && holds f (e :: u)) || (negb (relevant e) && holds (at_relevant f) u)).
  destruct (relevant e); simpl; auto using orb_false_r.
Qed.

Lemma at_relevant_filter : forall f g,
  (forall e u, relevant e = true -> holds g (e :: u) = holds f (e :: filter relevant u)) ->
  forall u, holds (at_relevant g) u = negb (is_nil (filter relevant u)) && holds f (filter relevant u).
Proof.
  intros f g H; induction u as [| e u IH]; [reflexivity |]. rewrite at_relevant_cons, IH. simpl.
  destruct (relevant e) eqn:R; auto. now rewrite H.
Qed.

Lemma relativised_holds : forall f, bounded f = true -> forall e u, relevant e = true ->
  holds (relativised f) (e :: u) = holds f (e :: filter relevant u).
Proof.
  induction f as [| | p | f IH | f IHf g IHg | f IHf g IHg | f IH | f IH | f IHf g IHg]; intros B e u R; simpl in B;
    try discriminate; auto.
  - simpl. now rewrite IH.
  - apply andb_true_iff in B as [B C]. simpl. now rewrite IHf, IHg.
  - apply andb_true_iff in B as [B C]. simpl. now rewrite IHf, IHg.
  - cbn [relativised]. specialize (IH B).
    change (holds (Next (at_relevant (relativised f))) (e :: u))
      with (negb (is_nil u) && holds (at_relevant (relativised f)) u).
    change (holds (Next f) (e :: filter relevant u))
      with (negb (is_nil (filter relevant u)) && holds f (filter relevant u)).
    rewrite at_relevant_filter with (f := f) by exact IH. destruct u; auto.
Qed.

(** A formula that is right under [strict] gives the texts for [projected] and [consecutive]. *)
Theorem text_of_correct : forall xs f, bounded f = true -> holds f [] = false ->
  (forall u, holds f u = true <-> Detected Strict xs u) ->
  forall s, s <> Scattered -> forall u, holds (text_of s f) u = true <-> Detected s xs u.
Proof.
  intros xs f B Z H s NS u.
  assert (P : forall u, holds (at_relevant (relativised f)) u = true <-> Detected Projected xs u).
  { intros w. rewrite detected_projected, <- H.
    rewrite (at_relevant_filter f) by (intros; now apply relativised_holds).
    destruct (filter relevant w); simpl; [rewrite Z |]; tauto. }
  destruct s; simpl text_of; [apply H | apply P | | congruence].
  rewrite detected_consecutive, holds_eventually. split.
  - intros (v & [| e w] & -> & N & K); [congruence |]. exists v, (e :: w); split; auto. apply P.
    change ((relevant e && holds (relativised f) (e :: w)) = true) in K. apply andb_true_iff in K as [R K].
    now rewrite at_relevant_cons, R.
  - intros (v & w & -> & D). apply P in D. revert v. induction w as [| e w IH]; intros v; [discriminate |].
    rewrite at_relevant_cons in D. destruct (relevant e) eqn:R.
    + exists v, (e :: w). repeat split; [discriminate |].
      change ((relevant e && holds (relativised f) (e :: w)) = true). now rewrite R.
    + destruct (IH D (v ++ [e])) as (v' & w' & Q & K). exists v', w'; split; auto. now rewrite <- Q, <- app_assoc.
Qed.

(** ** The sum over done sets *)

(** Steps that may come after some positions ([scattered]) or now ([strict]). *)
Definition await (s : semantics) (f : formula) : formula := match s with Scattered => Eventually f | _ => f end.

(** [p & X[!] after], or [p] when nothing follows. *)
Definition followed (p : nat) (after : option formula) : formula :=
  match after with Some f => Conj (Atom p) (Next f) | None => Atom p end.

(** G(S): some ready occurrence now, and then G of the larger done set. *)
Fixpoint sum_from (s : semantics) (x : shape) (fuel : nat) (done : list occurrence) : formula :=
  match fuel with
  | O => Falsity
  | S fuel =>
    await s (disjunction (map (fun o =>
      followed (requirement x o) (if finished x (o :: done) then None else Some (sum_from s x fuel (o :: done))))
      (filter (ready x done) (shape_occurrences x))))
  end.

(** A scenario is completed from a done set when it is, or by a later event that an occurrence uses. *)
Lemma completes_step : forall s x done u, finished x done = false ->
  (Completes s x done u <-> exists v e w o, u = v ++ e :: w /\ forallb (skips satisfies s) v = true /\
     counts satisfies s e = true /\ In o (shape_occurrences x) /\ ready x done o = true /\
     satisfies (requirement x o) e = true /\ Completes s x (o :: done) w).
Proof.
  intros s x done u F; split.
  - intros K. induction K as [d u F' | d e u S K IH | d e u o C I R S K _]; [congruence | |].
    + destruct (IH F) as (v & e' & w & o & -> & V & H). exists (e :: v), e', w, o; repeat split; try apply H.
      simpl; now rewrite S.
    + exists [], e, u, o; repeat split; auto.
  - intros (v & e & w & o & -> & V & C & I & R & S & K). induction v as [| e' v IH]; simpl in *.
    + now apply served with o.
    + apply andb_true_iff in V as [V V']. constructor 2; auto.
Qed.

Lemma holds_await : forall s f u, (s = Strict \/ s = Scattered) -> holds f [] = false ->
  (holds (await s f) u = true <->
   exists v e w, u = v ++ e :: w /\ forallb (skips satisfies s) v = true /\ holds f (e :: w) = true).
Proof.
  intros s f u [-> | ->] Z; simpl await.
  - split.
    + intros H. destruct u as [| e u]; [congruence |]. exists [], e, u; auto.
    + intros ([| a v] & e & w & -> & V & H); [exact H | discriminate].
  - rewrite holds_eventually. split.
    + intros (v & [| e w] & -> & N & H); [congruence |]. exists v, e, w; repeat split; auto.
      clear; induction v; auto.
    + intros (v & e & w & -> & _ & H). exists v, (e :: w); repeat split; auto; discriminate.
Qed.

Lemma holds_followed : forall p after e u, (forall f, after = Some f -> holds f [] = false) ->
  holds (followed p after) (e :: u) = satisfies p e && match after with Some f => holds f u | None => true end.
Proof.
  intros p [f |] e u Z; simpl followed.
  - change (holds (Conj (Atom p) (Next f)) (e :: u)) with (satisfies p e && (negb (is_nil u) && holds f u)).
    destruct u; simpl; auto. now rewrite (Z f).
  - simpl. now rewrite andb_true_r.
Qed.

Definition not_done (x : shape) (done : list occurrence) : nat :=
  length (filter (fun o => negb (among o done)) (shape_occurrences x)).

Lemma filter_less : forall (A : Type) (f g : A -> bool) l a, (forall b, f b = true -> g b = true) ->
  In a l -> f a = false -> g a = true -> length (filter f l) < length (filter g l).
Proof.
  intros A f g l a H. assert (W : forall l, length (filter f l) <= length (filter g l)).
  { induction l0 as [| b m IH]; simpl; auto. specialize (H b).
    destruct (f b), (g b); simpl; try lia; now discriminate H. }
  induction l as [| b l IH]; simpl; [tauto |]. intros [-> | I] F G.
  - rewrite F, G. simpl. specialize (W l). lia.
  - specialize (IH I F G). specialize (H b). destruct (f b), (g b); simpl; try lia; now discriminate H.
Qed.

Lemma not_done_less : forall x done o, In o (shape_occurrences x) -> ready x done o = true ->
  not_done x (o :: done) < not_done x done.
Proof.
  intros x done o I R. apply filter_less with o; auto.
  - intros p; simpl. destruct (same p o); simpl; [discriminate | auto].
  - simpl. now rewrite same_refl.
  - unfold ready in R. now apply andb_true_iff in R.
Qed.

Lemma sum_from_nil : forall s x fuel done, (s = Strict \/ s = Scattered) -> holds (sum_from s x fuel done) [] = false.
Proof.
  intros s x [| fuel] done [-> | ->]; simpl; auto. rewrite holds_disjunction, existsb_map.
  apply not_true_is_false. intros H. apply existsb_exists in H as (o & _ & H).
  destruct (finished x (o :: done)); simpl in H; discriminate.
Qed.

Lemma sum_from_correct : forall s x, (s = Strict \/ s = Scattered) -> forall fuel done u,
  not_done x done <= fuel -> finished x done = false ->
  (holds (sum_from s x fuel done) u = true <-> Completes s x done u).
Proof.
  intros s x S; induction fuel as [| fuel IH]; intros done u L F.
  - exfalso. unfold not_done in L. rewrite <- not_true_iff_false in F. apply F. apply forallb_forall. intros o I.
    destruct (among o done) eqn:A; auto.
    assert (J : In o (filter (fun o => negb (among o done)) (shape_occurrences x)))
      by (apply filter_In; rewrite A; auto).
    destruct (filter _ _); [destruct J | simpl in L; lia].
  - cbn [sum_from]. set (g := fun o => followed _ _). rewrite holds_await; auto.
    2:{ pose proof (sum_from_nil s x (Datatypes.S fuel) done S) as Z. cbn [sum_from] in Z. fold g in Z.
        destruct S as [-> | ->]; simpl await in Z; auto. rewrite holds_disjunction, existsb_map.
        apply not_true_is_false. intros H. apply existsb_exists in H as (o & _ & H).
        unfold g in H. destruct (finished x (o :: done)); simpl in H; discriminate. }
    rewrite completes_step by exact F.
    assert (G : forall e w,
      holds (disjunction (map g (filter (ready x done) (shape_occurrences x)))) (e :: w) = true <->
      exists o, In o (shape_occurrences x) /\ ready x done o = true /\ satisfies (requirement x o) e = true /\
                Completes s x (o :: done) w).
    { intros e w. rewrite holds_disjunction, existsb_map, existsb_exists.
      assert (GO : forall o, In o (shape_occurrences x) -> ready x done o = true ->
        (holds (g o) (e :: w) = true <-> satisfies (requirement x o) e = true /\ Completes s x (o :: done) w)).
      { intros o I R. unfold g. rewrite holds_followed.
        2:{ intros f Q. destruct (finished x (o :: done)); [discriminate |]. injection Q as <-.
            now apply sum_from_nil. }
        rewrite andb_true_iff. destruct (finished x (o :: done)) eqn:F'.
        - split; [intros [Q _]; split; auto; now constructor | tauto].
        - rewrite IH; [reflexivity | | exact F']. apply (not_done_less x done o I) in R. lia. }
      split.
      - intros (o & I & H). apply filter_In in I as [I R]. apply GO in H; auto. exists o; tauto.
      - intros (o & I & R & H). exists o; split; [now apply filter_In | now apply GO]. }
    assert (CO : forall e, counts satisfies s e = true) by (destruct S as [-> | ->]; auto).
    split.
    + intros (v & e & w & -> & V & H). apply G in H as (o & I & R & P & K). exists v, e, w, o; auto 10.
    + intros (v & e & w & o & -> & V & _ & I & R & P & K). exists v, e, w; repeat split; auto. apply G. exists o; auto.
Qed.

(** The base semantics of a text: only [scattered] is not made from [strict]. *)
Definition base (s : semantics) : semantics := match s with Scattered => Scattered | _ => Strict end.

Definition sum (s : semantics) (x : shape) : formula := sum_from (base s) x (length (shape_occurrences x)) [].
Definition sum_text (s : semantics) (xs : list shape) : formula := text_of s (disjunction (map (sum s) xs)).

Lemma base_cases : forall s, base s = Strict \/ base s = Scattered.
Proof. intros []; auto. Qed.

Lemma detected_base : forall s xs u, s = Strict \/ s = Scattered ->
  (Detected s xs u <-> exists x, In x xs /\ Completes s x [] u).
Proof.
  intros s xs u S. rewrite detected_completes. split.
  - intros (x & v & w & I & -> & [-> | Q] & K); [eauto | destruct S; congruence].
  - intros (x & I & K). exists x, [], u; auto.
Qed.

Lemma bounded_disjunction : forall l, forallb bounded l = true -> bounded (disjunction l) = true.
Proof.
  induction l as [| f l IH]; simpl; auto. rewrite andb_true_iff. intros [B C]. specialize (IH C).
  destruct f, (disjunction l); simpl in *; rewrite ?B, ?IH; auto.
Qed.

Lemma bounded_sum : forall x fuel done, bounded (sum_from Strict x fuel done) = true.
Proof.
  intros x; induction fuel as [| fuel IH]; intros done; auto. cbn [sum_from await]. apply bounded_disjunction.
  rewrite forallb_map. apply forallb_forall. intros o _. destruct (finished x (o :: done)); simpl; auto.
Qed.

(** The sums over done sets accept the traces with a detection, under all four semantics. *)
Theorem sum_text_correct : forall s xs, Forall (fun x => finished x [] = false) xs ->
  forall u, holds (sum_text s xs) u = true <-> Detected s xs u.
Proof.
  intros s xs N. rewrite Forall_forall in N.
  assert (B : forall b u, b = Strict \/ b = Scattered ->
    (holds (disjunction (map (sum b) xs)) u = true <-> Detected b xs u)).
  { intros b u Q. rewrite detected_base, holds_disjunction, existsb_map, existsb_exists by exact Q.
    assert (BB : base b = b) by (destruct Q as [-> | ->]; auto).
    assert (X : forall x, In x xs -> (holds (sum b x) u = true <-> Completes b x [] u)).
    { intros x I. unfold sum. rewrite BB. apply sum_from_correct; auto. unfold not_done. simpl.
      clear. induction (shape_occurrences x); simpl; lia. }
    split; intros (x & I & H); exists x; split; auto; now apply X. }
  assert (ST : forall b u, b <> Scattered -> holds (text_of b (disjunction (map (sum Strict) xs))) u = true <->
    Detected b xs u).
  { intros b u Q. apply text_of_correct; auto.
    - apply bounded_disjunction. rewrite forallb_map. apply forallb_forall. intros x _. apply bounded_sum.
    - rewrite holds_disjunction, existsb_map. apply not_true_is_false. intros H.
      apply existsb_exists in H as (x & _ & H). unfold sum in H. rewrite sum_from_nil in H; auto; discriminate. }
  intros u. destruct s; unfold sum_text.
  - apply ST; discriminate.
  - apply (ST Projected); discriminate.
  - apply (ST Consecutive); discriminate.
  - apply B; auto.
Qed.
End Semantics.
