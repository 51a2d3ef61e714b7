(** * What the clauses say besides: final verdicts, every guard, the ends of [pand] *)

Require Import List Bool Arith ZArith Lia Permutation.
Require Import RVAFT.Values RVAFT.Language RVAFT.Definition RVAFT.Search RVAFT.Conditions RVAFT.Scenarios
  RVAFT.Monitor.
Import ListNotations.

(** ** The search stays without partial matches once it has none *)

Lemma states_empty : forall E relevant s (c : plan E) u e,
  states relevant s c u = [] -> states relevant s c (u ++ [e]) = [].
Proof.
  intros E relevant s c u e H. rewrite states_snoc.
  destruct s; simpl; rewrite H; simpl; auto; destruct (relevant e); auto.
  rewrite app_nil_r. clear e. unfold start. destruct (plan_consistent c []) eqn:K; auto. exfalso.
  assert (X : In [] (states relevant Consecutive c u)).
  { clear H. induction u as [| e u IH] using rev_ind.
    - apply in_start; auto.
    - rewrite states_snoc; simpl. destruct (relevant e); auto. apply in_app_iff; left. now apply in_start. }
  rewrite H in X; destruct X.
Qed.

Lemma no_states : forall E relevant s (plans : list (plan E)) u v,
  (forall c, In c plans -> states relevant s c u = []) -> forall c, In c plans -> states relevant s c (u ++ v) = [].
Proof.
  intros E relevant s plans u v; induction v as [| e v IH] using rev_ind; intros H c I; [rewrite app_nil_r; auto |].
  rewrite app_assoc. apply states_empty. apply IH; auto.
Qed.

Lemma search_bottom_final : forall E relevant s (plans : list (plan E)) u v, Forall lawful plans ->
  Verdict (fun e => relevant e = true) (Scenarios plans) s u Bottom ->
  Verdict (fun e => relevant e = true) (Scenarios plans) s (u ++ v) Bottom.
Proof.
  intros E relevant s plans u v L [ND NL].
  assert (NONE : forall c, In c plans -> states relevant s c u = []).
  { intros c I. destruct (states relevant s c u) as [| m l] eqn:Q; auto. exfalso.
    assert (M : In m (states relevant s c u)) by (rewrite Q; simpl; auto).
    destruct (full c m) eqn:F.
    - apply ND, detected_states; auto. exists u, [], c. rewrite app_nil_r. repeat split; auto.
      apply existsb_exists; eauto.
    - apply NL, left_states; eauto. }
  split.
  - intros D. apply detected_states in D as (w & x & c & Q & I & F); auto.
    destruct (app_eq_app _ _ _ _ Q) as [y [[-> _] | [-> _]]].
    + (* the match ends before the end of u *)
      apply ND, detected_states; auto. exists w, y, c; auto.
    + rewrite (no_states _ _ _ plans u y) in F; auto. discriminate.
  - intros X. apply left_states in X as (c & I & m & M & _); auto. rewrite (no_states _ _ _ plans u v) in M; auto.
Qed.

(** ** Clause 4.4 *)

Lemma by_plans : forall t w s u v, WellFormed t ->
  (VerdictOfTree t w s u v <-> Verdict (fun e => relevant_event t e = true) (Scenarios (plans t w)) s u v).
Proof.
  intros t w s u v W. unfold VerdictOfTree.
  assert (R : forall e, relevant_event t e = true <-> RelevantEvent t e) by (intros; now apply relevant_event_iff).
  assert (F : forall c, IsScenario t w c -> exists d, Scenarios (plans t w) d /\ Alike c d).
  { intros c I. destruct (plans_complete t w c W I) as (d & J & A). exists (denoted d); split; auto. exists d; auto. }
  assert (B : forall d, Scenarios (plans t w) d -> exists c, IsScenario t w c /\ Alike d c).
  { intros c (d & I & ->). exists (denoted d). split; [now apply plans_sound |]. constructor; intros; reflexivity. }
  split; apply verdict_same; auto. intros; symmetry; auto.
Qed.

Theorem top_is_final : forall t w s u v, VerdictOfTree t w s u Top -> VerdictOfTree t w s (u ++ v) Top.
Proof. intros t w s u v (x & y & c & -> & I & M). exists x, (y ++ v), c. rewrite app_assoc; auto. Qed.

Theorem bottom_is_final : forall t w s u v, well_formed t = true ->
  VerdictOfTree t w s u Bottom -> VerdictOfTree t w s (u ++ v) Bottom.
Proof.
  intros t w s u v W H. apply well_formed_iff in W. apply by_plans in H; auto. apply by_plans; auto.
  apply search_bottom_final; auto. now apply plans_lawful.
Qed.

(** A scenario that may begin: some occurrence, and no guard fails before any event. *)
Definition MayBegin (t : tree) (w : selection) : Prop :=
  exists c o, IsScenario t w c /\ In o (occurrences c) /\ RVAFT.Definition.consistent c [].

Theorem never_bottom : forall t w s u, s = Scattered \/ s = Consecutive -> MayBegin t w ->
  ~ VerdictOfTree t w s u Bottom.
Proof.
  intros t w s u S (c & o & I & J & C) [_ H]. apply H. exists c; split; auto.
  exists (fun _ => 0), []. split; [constructor; simpl; auto; try tauto; [constructor | intros ? []] |].
  split; [intros K; apply (K o J) |]. destruct S as [-> | ->]; simpl; auto.
  exists (length u). intros i; split; [intros (x & [] & _) |]. intros [L (e & N & _)].
  assert (i < length u) by (apply nth_error_Some; congruence). lia.
Qed.

Theorem unknown_at_first : forall t w s, MayBegin t w ->
  (forall c, IsScenario t w c -> exists o, In o (occurrences c)) -> VerdictOfTree t w s [] Unknown.
Proof.
  intros t w s (c & o & I & J & C) ALL. split.
  - intros (x & y & d & Q & K & pos & m & P & F & _). symmetry in Q. apply app_eq_nil in Q as [-> ->].
    destruct (ALL d K) as [p O]. apply F in O. apply in_map_iff in O as ([q e] & _ & O).
    apply (at_positions _ _ _ _ P) in O. destruct (pos q); discriminate.
  - exists c; split; auto. exists (fun _ => 0), [].
    split; [constructor; simpl; auto; try tauto; [constructor | intros ? []] |].
    split; [intros K; apply (K o J) |].
    assert (N : forall i, ~ RelevantAt (RelevantEvent t) [] i) by (intros i (e & X & _); destruct i; discriminate).
    destruct s; simpl; auto.
    + intros i; split; [intros (x & [] & _) | lia].
    + intros i; split; [intros (x & [] & _) | intros X; destruct (N i X)].
    + exists 0. intros i; split; [intros (x & [] & _) | intros [_ X]; destruct (N i X)].
Qed.

(** ** Clause 3.1: in a match every guard holds, where the tree binds what its guards ask for *)

(** The guard [g] of the occurrence [o] has its variables and points bound. *)
Definition Bound (t : tree) (r : resolution) (o : occurrence) (g : guard) : Prop :=
  (forall x, In x (variables g) ->
     exists p q, Occurs t r p /\ on (node_at t (fst p)) = Some q /\ In x (pattern_variables q) /\
       if is_own t o x then p = o else is_own t p x = false) /\
  (forall n, In (At n) (points g) -> Occurs t r (n, 0)).

Theorem every_guard : forall t r m,
  (forall o, Occurs t r o -> In o (domain m)) -> Consistent t r m ->
  exists a own time, (forall o e, In (o, e) m -> Fits t (values_for t a own o) o e) /\
    (forall p z, time p = Some z <-> IsTime t r m p z) /\
    (forall o g, In (fst o) (map fst r) -> In g (conditions t (fst o)) -> Bound t r o g ->
       holds (values_for t a own o) time g = true).
Proof.
  intros t r m C (a & own & time & F & T & G & _). exists a, own, time. split; [auto | split; [auto |]].
  intros o g I J [B1 B2]. apply (G o g I J). split.
  - intros x X. destruct (B1 x X) as (p & q & O & P & V & H). exists p. repeat split; eauto.
  - intros p P. destruct p as [k | k | k]; [apply C, B2, P | |]; intros p [O _]; auto.
Qed.

(** ** Clause 2.5: the last position of each part is before that of each later part *)

Section Ends.
Variable t : tree.
Variable r : resolution.
Variable position : occurrence -> nat.

Definition IsLast (c : nat) (x : occurrence) : Prop :=
  InPart t r c x /\ forall o, InPart t r c o -> position o <= position x.

Definition EndsInOrder : Prop := forall n kept c d x y,
  In (n, kept) r -> gate_of (node_at t n) = Pand -> Earlier kept c d -> IsLast c x -> IsLast d y ->
    position x < position y.

(** The precedence that [Precedes] adds for [pand] is kept. *)
Definition EndPrecedence (last : nat -> nat -> occurrence) : Prop :=
  (forall n kept c o, In (n, kept) r -> gate_of (node_at t n) = Pand -> In c kept ->
     InPart t r c o -> o <> last n c -> position o < position (last n c)) /\
  (forall n kept c d p o, In (n, kept) r -> gate_of (node_at t n) = Pand -> Earlier kept c d ->
     InPart t r c p -> InPart t r d o -> position (last n c) < position (last n d)).

Fixpoint last_of (best : occurrence) (l : list occurrence) : occurrence :=
  match l with [] => best | o :: l => last_of (if position best <? position o then o else best) l end.

Lemma last_of_spec : forall l best, In (last_of best l) (best :: l) /\
  forall o, In o (best :: l) -> position o <= position (last_of best l).
Proof.
  induction l as [| x l IH]; intros best; cbn [last_of].
  - split; simpl; auto. intros o [<- | []]; auto.
  - destruct (position best <? position x) eqn:Q.
    + destruct (IH x) as [A B]. split; [simpl in *; tauto |]. apply Nat.ltb_lt in Q.
      intros o [<- | O]; [specialize (B x (or_introl eq_refl)); lia | auto].
    + destruct (IH best) as [A B]. split; [simpl in *; tauto |]. apply Nat.ltb_ge in Q.
      intros o [<- | [<- | O]]; [apply B; simpl; auto | specialize (B best (or_introl eq_refl)); lia | apply B;
        simpl; auto].
Qed.

(** For an injective [position], the order of the ends is the union over the choices of the last
    occurrences. *)
Theorem ends_iff : WellFormed t -> Resolution t r ->
  (forall o p, Occurs t r o -> Occurs t r p -> position o = position p -> o = p) ->
  (EndsInOrder <-> exists last, Lasts t r last /\ EndPrecedence last).
Proof.
  intros W R INJ. split.
  - intros E.
    set (last := fun (n c : nat) => match parts t r c with o :: l => last_of o l | [] => (0, 0) end).
    assert (L : forall n c o, InPart t r c o -> IsLast c (last n c)).
    { intros n c o I. assert (P := parts_iff t r W R c). unfold last. destruct (parts t r c) as [| x l].
      - apply P in I. destruct I.
      - destruct (last_of_spec l x) as [A B]. split; [now apply P | intros q Q; apply B; now apply P]. }
    exists last. split; [intros n kept c o _ _ _ I; apply (L n c o I) |]. split.
    + intros n kept c o _ _ _ I N. destruct (L n c o I) as [A B]. specialize (B o I).
      destruct (Nat.eq_dec (position o) (position (last n c))) as [Q | Q]; [| lia].
      destruct N. apply INJ; [apply I | apply A | auto].
    + intros n kept c d p o I G O P Q. apply (E n kept c d); auto; eapply L; eauto.
  - intros (last & L & E1 & E2) n kept c d x y I G O [X1 X2] [Y1 Y2].
    destruct (earlier_in _ _ _ _ O) as [C D].
    assert (SAME : forall b z, In b kept -> InPart t r b z -> (forall o, InPart t r b o -> position o <= position z) ->
      position z = position (last n b)).
    { intros b z B Z1 Z2. destruct (occurrence_dec z (last n b)) as [-> | N]; auto.
      assert (position z < position (last n b)) by (eapply E1; eauto).
      assert (position (last n b) <= position z) by (apply Z2; eapply L; eauto). lia. }
    rewrite (SAME c x), (SAME d y) by auto. eapply E2; eauto.
Qed.
End Ends.
