(** * What the clauses say besides: final verdicts, every guard, the ends of [pand] *)

Require Import List Bool Arith ZArith Lia Permutation.
Require Import RVAFT.Values RVAFT.Language RVAFT.Definition RVAFT.Search RVAFT.Conditions RVAFT.Scenarios
  RVAFT.Waiting RVAFT.Absences RVAFT.Monitor.
Import ListNotations.

(** ** The search stays without partial matches once it has none *)

Lemma start_stays : forall E relevant (c : plan E) u m, In m (start c) -> In m (states relevant Consecutive c u).
Proof.
  intros E relevant c u m H. induction u as [| e u IH] using rev_ind; [exact H |].
  rewrite states_snoc; simpl. destruct (relevant e); auto. apply in_app_iff; auto.
Qed.

Section Nothing.
Context {E : Type}.
Variable relevant : E -> bool.
Variables (s : semantics) (past : list E).

Lemma nothing_left : forall q u e, watchable q ->
  (forall m, ~ Kept relevant s q past u m) -> (forall m, ~ Waits relevant s q past u m) ->
  (forall m, ~ Kept relevant s q past (u ++ [e]) m) /\ (forall m, ~ Waits relevant s q past (u ++ [e]) m).
Proof.
  intros q u e W K N. assert (T : Tracks relevant s q past u ([], [])).
  { split; intros m; simpl; split; [intros [] | intros H; now apply (K m) | intros [] | intros H; now apply (N m)]. }
  apply (tracks_step relevant s q W past u e) in T as [TK TW]. cbn [fst snd] in TK, TW.
  assert (NO : forall m, is_unbroken q ((past ++ u) ++ [e]) m = true ->
    ~ In m (step (fun x => relevant (snd x)) s (lifted (watched_plan q)) (length (past ++ u), e) [])).
  { intros m U I. apply (step_cases relevant s q) in I as [[[] _] | [[(m0 & [] & _) _] | (I & -> & _)]].
    assert (J := I). apply in_start in J as [-> _].
    assert (V : is_unbroken q (past ++ u) [] = true).
    { apply (broken_stays q W _ e [] []); auto; [constructor | intros ? ? ? []]. }
    assert (ST : In [] (placed_states relevant Consecutive q (length past) u)) by now apply start_stays.
    destruct (full (lifted (watched_plan q)) []) eqn:F.
    - apply (N []). split; [exists u, []; now rewrite app_nil_r | auto].
    - apply (K []). split; auto. }
  split; intros m H.
  - apply TK, filter_In in H as [H _]. apply filter_In in H as [H U]. now apply (NO m).
  - apply TW, in_app_iff in H as [H | []]. apply filter_In in H as [H _]. apply filter_In in H as [H U].
    now apply (NO m).
Qed.

Lemma search_bottom_final : forall qs u v, Forall watchable qs ->
  Verdict (fun e => relevant e = true) (ScenariosAfter past qs) s u Bottom ->
  Verdict (fun e => relevant e = true) (ScenariosAfter past qs) s (u ++ v) Bottom.
Proof.
  intros qs u v W [ND NL]. rewrite Forall_forall in W.
  assert (NONE : forall y q, In q qs -> (forall m, ~ Kept relevant s q past (u ++ y) m) /\
    (forall m, ~ Waits relevant s q past (u ++ y) m)).
  { intros y q I. induction y as [| e y IH] using rev_ind; [| rewrite app_assoc; apply nothing_left; auto; apply IH].
    rewrite app_nil_r. split; intros m H.
    - apply NL. exists (denoted_after past q). split; [exists q; auto |]. apply left_waits; eauto.
    - destruct (is_decided q (past ++ u) m) eqn:D.
      + apply ND. exists u, [], (denoted_after past q). rewrite app_nil_r. split; [auto | split; [exists q; auto |]].
        apply match_waits; eauto.
      + apply NL. exists (denoted_after past q). split; [exists q; auto |]. apply left_waits; eauto. }
  split.
  - intros (w & x & sc & Q & (q & I & ->) & M). destruct (app_eq_app _ _ _ _ Q) as [y [[-> _] | [-> _]]].
    + apply ND. exists w, y, (denoted_after past q). split; [auto | split; [exists q; auto | auto]].
    + apply match_waits in M as (m & H & _); auto. now apply (proj2 (NONE y q I) m).
  - intros (sc & (q & I & ->) & P). destruct (NONE v q I) as [K N].
    apply left_waits in P as [(m & H) | (m & H & _)]; auto; [now apply (K m) | now apply (N m)].
Qed.
End Nothing.

(** ** Clause 4.4 *)

Lemma by_watched : forall t w s u v, WellFormed t ->
  (VerdictOfTree t w s u v <->
   Verdict (fun e => relevant_event t e = true) (ScenariosAfter [] (all_watched t w)) s u v).
Proof.
  intros t w s u v W. unfold VerdictOfTree.
  assert (R : forall e, relevant_event t e = true <-> RelevantEvent t e) by (intros; now apply relevant_event_iff).
  assert (F : forall c, IsScenario t w [] c -> exists d, ScenariosAfter [] (all_watched t w) d /\ Alike c d).
  { intros c I. destruct (watched_complete t w [] c W I) as (q & J & A). exists (denoted_after [] q); split; auto.
    exists q; auto. }
  assert (B : forall d, ScenariosAfter [] (all_watched t w) d -> exists c, IsScenario t w [] c /\ Alike d c).
  { intros c (q & I & ->). exists (denoted_after [] q). split; [now apply watched_sound |].
    constructor; intros; reflexivity || (split; reflexivity). }
  split; apply verdict_same; auto. intros; symmetry; auto.
Qed.

Lemma by_plans : forall t w s u v, WellFormed t -> no_absences t = true ->
  (VerdictOfTree t w s u v <-> Verdict (fun e => relevant_event t e = true) (Scenarios (plans t w)) s u v).
Proof.
  intros t w s u v W N. unfold VerdictOfTree.
  assert (R : forall e, relevant_event t e = true <-> RelevantEvent t e) by (intros; now apply relevant_event_iff).
  assert (F : forall c, IsScenario t w [] c -> exists d, Scenarios (plans t w) d /\ Alike c d).
  { intros c I. destruct (plans_complete t w [] c W N I) as (d & J & A). exists (denoted d); split; auto.
    exists d; auto. }
  assert (B : forall d, Scenarios (plans t w) d -> exists c, IsScenario t w [] c /\ Alike d c).
  { intros c (d & I & ->). exists (denoted d). split; [now apply plans_sound |].
    constructor; intros; reflexivity || (split; reflexivity). }
  split; apply verdict_same; auto. intros; symmetry; auto.
Qed.

Theorem top_is_final : forall t w s u v, VerdictOfTree t w s u Top -> VerdictOfTree t w s (u ++ v) Top.
Proof. intros t w s u v (x & y & c & -> & I & M). exists x, (y ++ v), c. rewrite app_assoc; auto. Qed.

Theorem bottom_is_final : forall t w s u v, well_formed t = true ->
  VerdictOfTree t w s u Bottom -> VerdictOfTree t w s (u ++ v) Bottom.
Proof.
  intros t w s u v W H. apply well_formed_iff in W. apply by_watched in H; auto. apply by_watched; auto.
  apply search_bottom_final; auto. now apply all_watchable.
Qed.

(** A scenario that may begin: some occurrence, and no guard or absent event fails before any event. *)
Definition MayBegin (t : tree) (w : selection) : Prop :=
  exists c o, IsScenario t w [] c /\ In o (occurrences c) /\ RVAFT.Definition.consistent c [] /\
    forall u position, unbroken c u position [].

(** No absent event fails before any event, if the part of its node has an occurrence. *)
Lemma unbroken_at_first : forall t r u position,
  (forall n c, In n (map fst r) -> In c (without (node_at t n)) -> exists o, InPart t r n o) ->
  Consistent t r [] -> Unbroken t r u position [].
Proof.
  intros t r u position P (a & own & H). exists a, own. split; auto. intros n c I J.
  destruct (P n c I J) as (o & O). split.
  - intros _ A. exact (False_ind _ (A o O)).
  - intros _ i (MB & _). destruct (side_of c) as [| d | d]; simpl in MB.
    + destruct MB as [(p & [_ B] & _) _]. exact B.
    + destruct MB as (A & _). exact (A o O).
    + destruct MB as ((p & [_ B]) & _). exact B.
Qed.

Theorem never_bottom : forall t w s u, s = Scattered \/ s = Consecutive -> MayBegin t w ->
  ~ VerdictOfTree t w s u Bottom.
Proof.
  intros t w s u S (c & o & I & J & C & U) [_ H]. apply H. exists c; split; auto.
  exists (fun _ => 0), []. split; [constructor; simpl; auto; try tauto; [constructor | intros ? []] |].
  split; [apply U |]. left. split; [intros K; apply (K o J) |]. destruct S as [-> | ->]; simpl; auto.
  exists (length u). intros i; split; [intros (x & [] & _) |]. intros [L (e & N & _)].
  assert (i < length u) by (apply nth_error_Some; congruence). lia.
Qed.

Theorem unknown_at_first : forall t w s, MayBegin t w ->
  (forall c, IsScenario t w [] c -> exists o, In o (occurrences c)) -> VerdictOfTree t w s [] Unknown.
Proof.
  intros t w s (c & o & I & J & C & U) ALL. split.
  - intros (x & y & d & Q & K & pos & m & P & F & _). symmetry in Q. apply app_eq_nil in Q as [-> ->].
    destruct (ALL d K) as [p O]. apply F in O. apply in_map_iff in O as ([q e] & _ & O).
    apply (at_positions _ _ _ _ P) in O. destruct (pos q); discriminate.
  - exists c; split; auto. exists (fun _ => 0), [].
    split; [constructor; simpl; auto; try tauto; [constructor | intros ? []] |].
    split; [apply U |]. left. split; [intros K; apply (K o J) |].
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
