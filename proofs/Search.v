(** * The search for matches, and why its verdicts are those of the definition

    The search keeps all partial matches of all scenarios, and extends them event by event.  It knows
    conditions (patterns, variables, guards, times) only as one Boolean test of an assignment, with
    two laws: the order of the assignment is irrelevant, and a part of a consistent assignment is
    consistent.  So the language of conditions can grow without a change here. *)

Require Import List Bool Arith Lia Permutation.
Require Import RVAFT.Language RVAFT.Definition.
Import ListNotations.

(** ** Occurrences are pairs of numbers *)

Definition same (o p : occurrence) : bool := (fst o =? fst p) && (snd o =? snd p).

Lemma same_iff : forall o p, same o p = true <-> o = p.
Proof.
  intros [a b] [c d]; unfold same; simpl. rewrite andb_true_iff, !Nat.eqb_eq.
  split; [intros [-> ->]; auto | intros H; injection H; auto].
Qed.

Lemma same_refl : forall o, same o o = true.
Proof. intros; now apply same_iff. Qed.

Lemma same_false : forall o p, o <> p -> same o p = false.
Proof. intros o p H; apply not_true_is_false; now rewrite same_iff. Qed.

Definition among (o : occurrence) (l : list occurrence) : bool := existsb (same o) l.

Lemma among_iff : forall o l, among o l = true <-> In o l.
Proof.
  unfold among; intros; rewrite existsb_exists; split.
  - intros (x & H & K). now apply same_iff in K as ->.
  - intros H; exists o; split; auto using same_refl.
Qed.

Lemma occurrence_dec : forall o p : occurrence, {o = p} + {o <> p}.
Proof. intros o p; destruct (same o p) eqn:Q; [left; now apply same_iff | right; intros H; apply same_iff in H;
  congruence]. Qed.

(** ** Positions *)

(** Which positions a match or a partial match may use depends on the relevant ones only. *)
Lemma positions_same : forall A B (R : A -> Prop) (R' : B -> Prop) s u u' used used', length u = length u' ->
  (forall i, RelevantAt R u i <-> RelevantAt R' u' i) -> (forall i, used i <-> used' i) ->
  (match_positions R s u used <-> match_positions R' s u' used') /\
  (partial_positions R s u used <-> partial_positions R' s u' used').
Proof.
  intros A B R R' s u u' used used' L RE U.
  destruct s; simpl; rewrite ?L; split; repeat setoid_rewrite U; repeat setoid_rewrite RE; tauto.
Qed.

(** ** The search *)

Section Search.
Context {E : Type}.
Variable relevant : E -> bool.

(** A scenario as the search has it. *)
Record plan := Plan {
  plan_occurrences : list occurrence;
  plan_before : occurrence -> occurrence -> bool;
  plan_consistent : assigned E -> bool }.

Definition denoted (c : plan) : scenario E :=
  Scenario E (plan_occurrences c) (fun p o => plan_before c p o = true)
    (fun m => plan_consistent c m = true)
    (fun _ _ _ => True) (fun _ _ _ => True).

Record lawful (c : plan) : Prop := {
  in_any_order : forall m m', NoDup (domain m) -> Permutation m m' -> plan_consistent c m = true ->
    plan_consistent c m' = true;
  in_part : forall x m, NoDup (domain (x :: m)) -> plan_consistent c (x :: m) = true -> plan_consistent c m = true }.

(** The extensions of a partial match by an event. *)
Definition extend (c : plan) (e : E) (m : assigned E) : list (assigned E) :=
  let done := domain m in
  flat_map (fun o =>
    if negb (among o done)
       && forallb (fun p => implb (plan_before c p o) (among p done)) (plan_occurrences c)
       && plan_consistent c ((o, e) :: m)
    then [(o, e) :: m] else []) (plan_occurrences c).

Definition start (c : plan) : list (assigned E) := if plan_consistent c [] then [[]] else [].

Definition step (s : semantics) (c : plan) (e : E) (partial : list (assigned E)) : list (assigned E) :=
  match s with
  | Strict => flat_map (extend c e) partial
  | Projected => if relevant e then flat_map (extend c e) partial else partial
  | Consecutive => if relevant e then start c ++ flat_map (extend c e) partial else partial
  | Scattered => partial ++ flat_map (extend c e) partial
  end.

(** The partial matches after a trace. *)
Definition states s c (trace : list E) : list (assigned E) :=
  fold_left (fun partial e => step s c e partial) trace (start c).

Definition full (c : plan) (m : assigned E) : bool := forallb (fun o => among o (domain m)) (plan_occurrences c).

Inductive monitor := Done | Running (l : list (plan * list (assigned E))).
Definition settle (l : list (plan * list (assigned E))) : monitor :=
  if existsb (fun x => existsb (full (fst x)) (snd x)) l then Done else Running l.
Definition init (plans : list plan) : monitor := settle (map (fun c => (c, start c)) plans).
Definition advance (s : semantics) (m : monitor) (e : E) : monitor :=
  match m with
  | Done => Done
  | Running l => settle (map (fun x => (fst x, step s (fst x) e (snd x))) l)
  end.
Definition is_nil {A} (l : list A) : bool := match l with [] => true | _ => false end.
Lemma is_nil_iff : forall A (l : list A), is_nil l = true <-> l = [].
Proof. intros A [| x l]; simpl; split; congruence. Qed.
Definition verdict_of (m : monitor) : verdict :=
  match m with
  | Done => Top
  | Running l => if forallb (fun x => is_nil (snd x)) l then Bottom else Unknown
  end.
Definition run s plans (trace : list E) : monitor := fold_left (advance s) trace (init plans).

(** ** Partial matches, one event at a time *)

Notation Rel := (fun e => relevant e = true).
Notation Partial c := (Partial (denoted c)).
Notation RelevantAt := (RelevantAt Rel).
Notation partial_positions := (partial_positions Rel).

Lemma full_iff : forall c m, full c m = true <-> complete (denoted c) m.
Proof.
  unfold full, complete, incl; intros; rewrite forallb_forall. split; intros H a K.
  - apply among_iff; auto.
  - apply among_iff; auto.
Qed.

Lemma in_extend : forall c e m m', In m' (extend c e m) <->
  exists o, m' = (o, e) :: m /\ In o (plan_occurrences c) /\ ~ In o (domain m) /\
    (forall p, In p (plan_occurrences c) -> plan_before c p o = true -> In p (domain m)) /\
    plan_consistent c ((o, e) :: m) = true.
Proof.
  intros; unfold extend; rewrite in_flat_map. split.
  - intros (o & Ho & H).
    destruct (negb (among o (domain m))
              && forallb (fun p => implb (plan_before c p o) (among p (domain m))) (plan_occurrences c)
              && plan_consistent c ((o, e) :: m)) eqn:C; simpl in H; [| tauto].
    destruct H as [<- | []]. apply andb_true_iff in C as [C K]. apply andb_true_iff in C as [C F].
    exists o; repeat split; auto.
    + intros I. apply among_iff in I. rewrite I in C; discriminate.
    + intros p Hp B. rewrite forallb_forall in F. specialize (F p Hp). rewrite B in F. now apply among_iff.
  - intros (o & -> & Ho & N & D & K). exists o; split; auto.
    replace (among o (domain m)) with false
      by (symmetry; apply not_true_is_false; rewrite among_iff; auto).
    replace (forallb _ _) with true.
    + rewrite K; simpl; auto.
    + symmetry; apply forallb_forall. intros p Hp. destruct (plan_before c p o) eqn:B; simpl; auto.
      apply among_iff; auto.
Qed.

Lemma states_snoc : forall s c trace e, states s c (trace ++ [e]) = step s c e (states s c trace).
Proof. intros; unfold states; now rewrite fold_left_app. Qed.

Lemma in_domain : forall (m : assigned E) o, In o (domain m) <-> exists e, In (o, e) m.
Proof.
  unfold domain; intros; rewrite in_map_iff; split.
  - intros ((a, e) & <- & H); eauto.
  - intros (e & H); exists (o, e); auto.
Qed.

Lemma nth_app_some : forall (u v : list E) i e, nth_error u i = Some e -> nth_error (u ++ v) i = Some e.
Proof. intros; rewrite nth_error_app1; auto. apply nth_error_Some; congruence. Qed.

Lemma nth_end : forall (u : list E) e, nth_error (u ++ [e]) (length u) = Some e.
Proof. intros; rewrite nth_error_app2, Nat.sub_diag; auto. Qed.

Lemma partial_app : forall c u v pos m, Partial c u pos m -> Partial c (u ++ v) pos m.
Proof. intros c u v pos m []; constructor; auto. intros; apply nth_app_some; auto. Qed.

Lemma position_bound : forall c u pos m o, Partial c u pos m -> In o (domain m) -> pos o < length u.
Proof.
  intros c u pos m o H I. apply in_domain in I as [e I]. apply (at_positions _ _ _ _ H) in I.
  apply nth_error_Some; congruence.
Qed.

(** A partial match and one more event. *)
Lemma partial_extend : forall c u e pos m o, lawful c -> Partial c u pos m ->
  In o (plan_occurrences c) -> ~ In o (domain m) ->
  (forall p, In p (plan_occurrences c) -> plan_before c p o = true -> In p (domain m)) ->
  plan_consistent c ((o, e) :: m) = true ->
  exists pos', Partial c (u ++ [e]) pos' ((o, e) :: m) /\
    forall i, Used pos' ((o, e) :: m) i <-> Used pos m i \/ i = length u.
Proof.
  intros c u e pos m o L H Ho N D K.
  set (pos' := fun x => if same x o then length u else pos x).
  assert (Po : pos' o = length u) by (unfold pos'; now rewrite same_refl).
  assert (Pm : forall x, In x (domain m) -> pos' x = pos x).
  { intros x I; unfold pos'. destruct (same x o) eqn:Q; auto. apply same_iff in Q; subst; contradiction. }
  assert (Lt : forall x, In x (domain m) -> pos' x < length u) by (intros; rewrite Pm; eauto using position_bound).
  clearbody pos'. exists pos'. split; [constructor |]; simpl.
  - constructor; auto. apply H.
  - intros x [<- | I]; auto. now apply (of_scenario _ _ _ _ H).
  - intros x f [Q | I].
    + injection Q; intros; subst. rewrite Po. apply nth_end.
    + assert (In x (domain m)) by (apply in_domain; eauto). rewrite Pm by auto.
      apply nth_app_some. now apply (at_positions _ _ _ _ H).
  - intros x y [<- | I] [<- | J] Q; auto.
    + apply Lt in J; lia.
    + apply Lt in I; lia.
    + rewrite !Pm in Q by auto. now apply (no_position_twice _ _ _ _ H).
  - intros x y [<- | I] Hy B; auto. right; now apply (downward_closed _ _ _ _ H x).
  - intros x y [<- | I] [<- | J] B.
    + exfalso; auto.
    + apply Lt in J; lia.
    + exfalso; apply N. now apply (downward_closed _ _ _ _ H x).
    + rewrite !Pm by auto. now apply (precedence_kept _ _ _ _ H).
  - exact K.
  - intros i; split.
    + intros (x & [<- | I] & Q); simpl in Q; [right; lia | left; exists x; split; auto]. rewrite <- Pm; auto.
    + intros [(x & I & Q) | ->].
      * exists x; split; simpl; auto. now rewrite Pm.
      * exists o; simpl; auto.
Qed.

(** A partial match and one event less: the last event is not used, or one occurrence has it. *)
Lemma partial_shrink : forall c u e pos m, lawful c -> Partial c (u ++ [e]) pos m ->
  (~ Used pos m (length u) /\ Partial c u pos m) \/
  (exists o m0, Permutation m ((o, e) :: m0) /\ Partial c u pos m0 /\
     In o (plan_occurrences c) /\ ~ In o (domain m0) /\ pos o = length u /\
     (forall p, In p (plan_occurrences c) -> plan_before c p o = true -> In p (domain m0)) /\
     plan_consistent c ((o, e) :: m0) = true /\ (forall i, Used pos m i <-> Used pos m0 i \/ i = length u)).
Proof.
  intros c u e pos m L H.
  assert (Lt := fun o I => position_bound _ _ _ _ o H I).
  rewrite app_length in Lt; simpl in Lt.
  destruct (find (fun x => pos (fst x) =? length u) m) as [[o f] |] eqn:F.
  - right. apply find_some in F as [I Q]. simpl in Q; apply Nat.eqb_eq in Q.
    assert (f = e). { apply (at_positions _ _ _ _ H) in I. rewrite Q, nth_end in I. congruence. } subst f.
    apply in_split in I as (l1 & l2 & ->).
    set (m0 := l1 ++ l2).
    assert (P : Permutation (l1 ++ (o, e) :: l2) ((o, e) :: m0)) by (symmetry; apply Permutation_middle).
    assert (PD : Permutation (domain (l1 ++ (o, e) :: l2)) (o :: domain m0)) by (apply (Permutation_map fst) in P;
      exact P).
    assert (ID : forall x, In x (domain (l1 ++ (o, e) :: l2)) <-> o = x \/ In x (domain m0)).
    { intros x; split; intros I. apply (Permutation_in _ PD) in I; auto.
      apply (Permutation_in _ (Permutation_sym PD)); auto. }
    assert (ND : NoDup (o :: domain m0)) by (apply (Permutation_NoDup PD); apply H).
    inversion ND as [| ? ? No Nd]; subst.
    assert (K : plan_consistent c ((o, e) :: m0) = true)
      by (apply (in_any_order _ L _ _ (once _ _ _ _ H) P); apply (conditions_hold _ _ _ _ H)).
    assert (Lt0 : forall x, In x (domain m0) -> pos x < length u).
    { intros x I. assert (J : In x (domain (l1 ++ (o, e) :: l2))) by (apply ID; auto).
      destruct (Nat.eq_dec (pos x) (length u)) as [R | R].
      - assert (x = o); [| subst; contradiction].
        apply (no_position_twice _ _ _ _ H); auto; [apply ID; auto | congruence].
      - apply Lt in J; lia. }
    exists o, m0. split; auto. split; [constructor | repeat split]; auto.
    + intros x I; apply (of_scenario _ _ _ _ H), ID; auto.
    + intros x f I.
      assert (J : In x (domain m0)) by (apply in_domain; eauto).
      assert (R : nth_error (u ++ [e]) (pos x) = Some f).
      { apply (at_positions _ _ _ _ H). apply (Permutation_in _ (Permutation_sym P)); simpl; auto. }
      rewrite nth_error_app1 in R; auto.
    + intros x y I J. apply (no_position_twice _ _ _ _ H); apply ID; auto.
    + intros x y I J B.
      assert (In y (domain (l1 ++ (o, e) :: l2))) as R by (apply (downward_closed _ _ _ _ H x); auto; apply ID; auto).
      apply ID in R as [<- | R]; auto. exfalso.
      assert (pos o < pos x) by (apply (precedence_kept _ _ _ _ H); auto; apply ID; auto). apply Lt0 in I; lia.
    + intros x y I J. apply (precedence_kept _ _ _ _ H); apply ID; auto.
    + now apply (in_part _ L) in K; [| exact ND].
    + apply (of_scenario _ _ _ _ H), ID; auto.
    + intros p Hp B.
      assert (In p (domain (l1 ++ (o, e) :: l2))) as R by (apply (downward_closed _ _ _ _ H o); auto; apply ID; auto).
      assert (pos p < pos o) by (apply (precedence_kept _ _ _ _ H); auto; apply ID; auto).
      apply ID in R as [<- | R]; auto. lia.
    + intros (x & I & R). apply ID in I as [<- | I]; [right; lia | left; exists x; auto].
    + intros [(x & I & R) | ->]; [exists x; split; auto; apply ID; auto | exists o; split; auto; apply ID; auto].
  - left. split.
    + intros (o & I & Q). apply in_domain in I as [f I]. apply (find_none _ _ F) in I.
      simpl in I; apply Nat.eqb_neq in I; auto.
    + destruct H as [h1 h2 h3 h4 h5 h6 h7]; constructor; auto. intros o f I.
      assert (pos o < length u).
      { assert (In o (domain m)) as J by (apply in_domain; eauto). apply Lt in J.
        apply (find_none _ _ F) in I. simpl in I; apply Nat.eqb_neq in I. lia. }
      apply h3 in I. rewrite nth_error_app1 in I; auto.
Qed.

Lemma relevant_snoc : forall u e i, RelevantAt (u ++ [e]) i <-> RelevantAt u i \/ (i = length u /\ relevant e = true).
Proof.
  intros; split.
  - intros (f & H & R). destruct (lt_eq_lt_dec i (length u)) as [[Q | Q] | Q].
    + rewrite nth_error_app1 in H by auto; left; exists f; auto.
    + subst; rewrite nth_end in H; injection H as ->; auto.
    + exfalso. assert (i < length (u ++ [e])) by (apply nth_error_Some; congruence).
      rewrite app_length in *; simpl in *; lia.
  - intros [(f & H & R) | [-> R]]; [exists f; split; auto; now apply nth_app_some | exists e; split; auto;
      apply nth_end].
Qed.

Lemma relevant_bound : forall u i, RelevantAt u i -> i < length u.
Proof. intros u i (e & H & _). apply nth_error_Some; congruence. Qed.

Lemma used_bound : forall c u pos m i, Partial c u pos m -> Used pos m i -> i < length u.
Proof. intros c u pos m i H (o & I & <-). eapply position_bound; eauto. Qed.

Lemma partial_nil : forall c u pos, plan_consistent c [] = true -> Partial c u pos [].
Proof. intros; constructor; simpl; try tauto; [constructor | intros ? []]. Qed.

Lemma used_nil : forall pos i, ~ Used pos ([] : assigned E) i.
Proof. intros pos i (o & [] & _). Qed.

Lemma in_start : forall c m, In m (start c) <-> m = [] /\ plan_consistent c [] = true.
Proof. intros; unfold start. destruct (plan_consistent c []); simpl; intuition congruence. Qed.

(** ** The states of the search are the partial matches *)

Theorem states_sound : forall s c, lawful c -> forall u m, In m (states s c u) ->
  exists pos, Partial c u pos m /\ partial_positions s u (Used pos m).
Proof.
  intros s c L u; induction u as [| e u IH] using rev_ind; intros m H.
  - unfold states in H; simpl in H. apply in_start in H as [-> K].
    exists (fun _ => 0); split; [now apply partial_nil |].
    assert (N := used_nil (fun _ => 0)).
    assert (R : forall i, ~ RelevantAt [] i) by (intros i F; apply relevant_bound in F; simpl in F; lia).
    destruct s; simpl; auto.
    + intros i; split; intros F; [destruct (N i F) | lia].
    + intros i; split; intros F; [destruct (N i F) | destruct (R i F)].
    + exists 0; intros i; split; intros F; [destruct (N i F) | destruct (R i); tauto].
  - rewrite states_snoc in H.
    assert (EX : forall m0, In m0 (states s c u) -> In m (extend c e m0) ->
      exists pos0 pos, Partial c u pos0 m0 /\ partial_positions s u (Used pos0 m0) /\
        Partial c (u ++ [e]) pos m /\ forall i, Used pos m i <-> Used pos0 m0 i \/ i = length u).
    { intros m0 I0 IE. apply IH in I0 as (pos0 & P0 & A0). apply in_extend in IE as (o & -> & Ho & N & D & K).
      destruct (partial_extend c u e pos0 m0 o L P0 Ho N D K) as (pos & P & U). exists pos0, pos; auto. }
    assert (KEEP : In m (states s c u) -> s = Scattered \/ (relevant e = false /\ s <> Strict) ->
      exists pos, Partial c (u ++ [e]) pos m /\ partial_positions s (u ++ [e]) (Used pos m)).
    { intros I0 C. apply IH in I0 as (pos & P & A). exists pos; split; [now apply partial_app |].
      destruct C as [-> | [R NS]]; simpl; auto.
      assert (RR : forall i, RelevantAt (u ++ [e]) i <-> RelevantAt u i).
      { intros i; rewrite relevant_snoc; rewrite R; intuition discriminate. }
      destruct s; simpl in *; try tauto.
      - intros i; now rewrite RR.
      - destruct A as [j A]; exists j; intros i; now rewrite RR. }
    destruct s; simpl in H.
    + apply in_flat_map in H as (m0 & I0 & IE). destruct (EX m0 I0 IE) as (pos0 & pos & P0 & A0 & P & U).
      exists pos; split; auto. simpl in *. intros i; rewrite U, A0, app_length; simpl; lia.
    + destruct (relevant e) eqn:R; [| apply KEEP; auto; right; split; auto; discriminate].
      apply in_flat_map in H as (m0 & I0 & IE). destruct (EX m0 I0 IE) as (pos0 & pos & P0 & A0 & P & U).
      exists pos; split; auto. simpl in *. intros i; rewrite U, A0, relevant_snoc; tauto.
    + destruct (relevant e) eqn:R; [| apply KEEP; auto; right; split; auto; discriminate].
      apply in_app_iff in H as [H | H].
      * apply in_start in H as [-> K]. exists (fun _ => 0); split; [now apply partial_nil |].
        exists (S (length u)). intros i; split; [intros F; destruct (used_nil _ _ F) |].
        intros [F G]; apply relevant_bound in G. rewrite app_length in G; simpl in G; lia.
      * apply in_flat_map in H as (m0 & I0 & IE). destruct (EX m0 I0 IE) as (pos0 & pos & P0 & A0 & P & U).
        exists pos; split; auto. destruct A0 as [j A0].
        destruct (le_lt_dec j (length u)) as [Q | Q].
        -- exists j. intros i; rewrite U, A0, relevant_snoc. intuition lia.
        -- exists (length u). intros i; rewrite U, A0, relevant_snoc. split.
           ++ intros [[F G] | F]; [apply relevant_bound in G; lia | intuition lia].
           ++ intros [F [G | [G _]]]; [apply relevant_bound in G; lia | auto].
    + apply in_app_iff in H as [H | H]; [apply KEEP; auto |].
      apply in_flat_map in H as (m0 & I0 & IE). destruct (EX m0 I0 IE) as (pos0 & pos & P0 & A0 & P & U).
      exists pos; simpl; auto.
Qed.

Lemma in_extend_permuted : forall c e m m0 m1 o, lawful c -> Permutation m ((o, e) :: m0) -> Permutation m0 m1 ->
  In o (plan_occurrences c) -> ~ In o (domain m0) ->
  (forall p, In p (plan_occurrences c) -> plan_before c p o = true -> In p (domain m0)) ->
  NoDup (domain m0) -> plan_consistent c ((o, e) :: m0) = true ->
  In ((o, e) :: m1) (extend c e m1) /\ Permutation m ((o, e) :: m1).
Proof.
  intros c e m m0 m1 o L P Q Ho N D ND K.
  assert (S : forall x, In x (domain m0) <-> In x (domain m1)).
  { intros x; split; apply Permutation_in; [| apply Permutation_sym]; now apply Permutation_map. }
  split.
  - apply in_extend. exists o; repeat split; auto.
    + now rewrite <- S.
    + intros p Hp B; apply S; auto.
    + refine (in_any_order _ L _ _ _ (perm_skip (o, e) Q) K). simpl; now constructor.
  - eapply perm_trans; eauto.
Qed.

Theorem states_complete : forall s c, lawful c -> forall u pos m,
  Partial c u pos m -> partial_positions s u (Used pos m) ->
  exists m', In m' (states s c u) /\ Permutation m m'.
Proof.
  intros s c L u; induction u as [| e u IH] using rev_ind; intros pos m H A.
  - assert (m = []) as ->.
    { destruct m as [| [o f] m]; auto. exfalso.
      assert (pos o < length (@nil E)) by (eapply position_bound; eauto; simpl; auto). simpl in *; lia. }
    exists []; split; auto. apply in_start; split; auto. apply (conditions_hold _ _ _ _ H).
  - rewrite states_snoc.
    assert (ST : In [] (start c)).
    { apply in_start; split; auto. assert (K := conditions_hold _ _ _ _ H). assert (ND := once _ _ _ _ H). clear H A.
      simpl in K. induction m as [| x m IHm]; auto. apply (in_part _ L) in K; auto. inversion ND; auto. }
    destruct (partial_shrink c u e pos m L H) as [[N P] | (o & m0 & P & P0 & Ho & N & Po & D & K & U)].
    + (* the last event is not used *)
      assert (PASS : partial_positions s u (Used pos m) -> s = Scattered \/ (relevant e = false /\ s <> Strict) ->
        exists m', In m' (step s c e (states s c u)) /\ Permutation m m').
      { intros A' C. destruct (IH pos m P A') as (m' & I & Q). exists m'; split; auto.
        destruct C as [-> | [R NS]]; simpl; [apply in_app_iff; auto |].
        destruct s; simpl; try rewrite R; auto; [destruct (NS eq_refl) | apply in_app_iff; auto]. }
      destruct s; simpl in A.
      * exfalso; apply N, A. rewrite app_length; simpl; lia.
      * destruct (relevant e) eqn:R.
        -- exfalso; apply N, A, relevant_snoc; auto.
        -- apply PASS; [| right; split; auto; discriminate]. simpl. intros i; rewrite A, relevant_snoc, R.
           intuition discriminate.
      * destruct A as [j A]. destruct (relevant e) eqn:R.
        -- (* only possible when nothing is used at all *)
           assert (Q : length u < j).
           { destruct (le_lt_dec j (length u)); auto. exfalso; apply N, A; split; auto. apply relevant_snoc; auto. }
           assert (m = []) as ->.
           { destruct m as [| [o f] m]; auto. exfalso.
             assert (U : Used pos ((o, f) :: m) (pos o)) by (exists o; simpl; auto).
             assert (pos o < length u) by (eapply used_bound; eauto). apply A in U. lia. }
           exists []; split; auto. simpl. rewrite R. apply in_app_iff; auto.
        -- apply PASS; [| right; split; auto; discriminate]. exists j. intros i; rewrite A, relevant_snoc, R.
           intuition discriminate.
      * apply PASS; simpl; auto.
    + (* it is used by o *)
      assert (U0 : forall i, Used pos m0 i <-> Used pos m i /\ i <> length u).
      { intros i; rewrite U. split; [| tauto]. intros F; split; auto. apply (used_bound _ _ _ _ _ P0) in F; lia. }
      assert (EXT : partial_positions s u (Used pos m0) -> exists m1, In m1 (states s c u) /\
        In ((o, e) :: m1) (extend c e m1) /\ Permutation m ((o, e) :: m1)).
      { intros A'. destruct (IH pos m0 P0 A') as (m1 & I & Q). exists m1; split; auto.
        apply (in_extend_permuted c e m m0 m1 o); auto. apply P0. }
      assert (RE : s = Projected \/ s = Consecutive -> relevant e = true).
      { intros C. assert (X : Used pos m (length u)) by (apply U; auto).
        assert (Y : RelevantAt (u ++ [e]) (length u)).
        { destruct C as [-> | ->]; [now apply A | destruct A as [j A]; now apply A]. }
        apply relevant_snoc in Y as [Y | [_ Y]]; auto. apply relevant_bound in Y; lia. }
      assert (A' : partial_positions s u (Used pos m0)).
      { destruct s; simpl in *; auto.
        - intros i; rewrite U0, A, app_length; simpl; lia.
        - intros i; rewrite U0, A, relevant_snoc. split; [intros [[F | [F _]] G]; tauto |].
          intros F; split; [tauto |]. apply relevant_bound in F; lia.
        - destruct A as [j A]; exists j; intros i; rewrite U0, A, relevant_snoc.
          split; [intros [[F [G | [G _]]] J]; tauto |]. intros [F G]; split; [tauto |].
          apply relevant_bound in G; lia. }
      destruct (EXT A') as (m1 & I & X & Q). exists ((o, e) :: m1); split; auto.
      destruct s; simpl; try rewrite RE by auto; try (apply in_app_iff; right); apply in_flat_map; eauto.
Qed.

(** ** Matches and verdicts *)

Notation Match s c := (Match Rel s (denoted c)).
Definition Scenarios (plans : list plan) (sc : scenario E) : Prop := exists c, In c plans /\ sc = denoted c.
Notation Detected s plans := (Detected Rel (Scenarios plans) s).
Notation Left s plans := (Left Rel (Scenarios plans) s).
Notation Verdict s plans := (Verdict Rel (Scenarios plans) s).

(** A match that ends with the trace. *)
Definition Whole s c w := exists pos m, Partial c w pos m /\ complete (denoted c) m /\
  partial_positions s w (Used pos m).

Lemma nth_firstn : forall k (u : list E) i, i < k -> nth_error (firstn k u) i = nth_error u i.
Proof. induction k; intros u i H; [lia |]. destruct u; simpl; auto. destruct i; simpl; auto. apply IHk; lia. Qed.

Lemma relevant_firstn : forall k u i, RelevantAt (firstn k u) i <-> i < k /\ RelevantAt u i.
Proof.
  intros; split.
  - intros (e & H & R). assert (i < length (firstn k u)) by (apply nth_error_Some; congruence).
    rewrite firstn_length in *. assert (i < k) by lia. rewrite nth_firstn in H by auto. split; auto. exists e; auto.
  - intros (Q & e & H & R). exists e; split; auto. now rewrite nth_firstn.
Qed.

(** A partial match that may be one with these positions ends with a prefix of the trace. *)
Lemma match_prefix : forall s c u pos m, Partial c u pos m -> match_positions Rel s u (Used pos m) ->
  exists w v, u = w ++ v /\ Partial c w pos m /\ partial_positions s w (Used pos m).
Proof.
  intros s c u pos m H A.
  assert (CUT : forall k, (forall i, Used pos m i -> i < k) -> Partial c (firstn k u) pos m).
  { intros k B. destruct H as [h1 h2 h3 h4 h5 h6 h7]; constructor; auto. intros o e I. rewrite nth_firstn; auto.
    apply B. exists o; split; auto. apply in_domain; eauto. }
  destruct s; simpl in A.
  - destruct A as [k A]. exists (firstn k u), (skipn k u). rewrite firstn_skipn; split; auto. split.
    + apply CUT; intros i F; now apply A.
    + intros i; split.
      * intros F. assert (i < length u) by (eapply used_bound; eauto). rewrite firstn_length. apply A in F; lia.
      * intros F. rewrite firstn_length in F. apply A; lia.
  - destruct A as [k A]. exists (firstn k u), (skipn k u). rewrite firstn_skipn; split; auto. split.
    + apply CUT; intros i F; now apply A.
    + intros i; split.
      * intros F. apply relevant_firstn; now apply A.
      * intros F. apply A. now apply relevant_firstn in F.
  - destruct A as (j & k & A). exists (firstn k u), (skipn k u). rewrite firstn_skipn; split; auto. split.
    + apply CUT; intros i F; now apply A.
    + exists j; intros i. rewrite relevant_firstn, A. tauto.
  - exists u, []. rewrite app_nil_r; simpl; auto.
Qed.

Lemma prefix_match : forall s c w v pos m, Partial c w pos m -> partial_positions s w (Used pos m) ->
  Partial c (w ++ v) pos m /\ match_positions Rel s (w ++ v) (Used pos m).
Proof.
  intros s c w v pos m H A. split; [now apply partial_app |].
  assert (RW : forall i, RelevantAt w i <-> i < length w /\ RelevantAt (w ++ v) i).
  { intros i; split.
    - intros F; split; [now apply relevant_bound in F |]. destruct F as (e & F & R); exists e; split; auto.
      now apply nth_app_some.
    - intros (Q & e & F & R). rewrite nth_error_app1 in F by auto. exists e; auto. }
  destruct s; simpl in *; auto.
  - eauto.
  - exists (length w); intros i. now rewrite A, RW.
  - destruct A as [j A]. exists j, (length w); intros i. rewrite A, RW. tauto.
Qed.

Lemma match_iff : forall s c u, Match s c u <-> exists w v, u = w ++ v /\ Whole s c w.
Proof.
  intros s c u; split.
  - intros (pos & m & H & C & A & _). destruct (match_prefix s c u pos m H A) as (w & v & -> & P & B).
    exists w, v. split; auto. exists pos, m; auto.
  - intros (w & v & -> & pos & m & H & C & A). destruct (prefix_match s c w v pos m H A) as [P M].
    exists pos, m; simpl; auto.
Qed.

Lemma whole_states : forall s c, lawful c -> forall w,
  Whole s c w <-> existsb (full c) (states s c w) = true.
Proof.
  intros s c L w; rewrite existsb_exists; split.
  - intros (pos & m & H & C & A). destruct (states_complete s c L w pos m H A) as (m' & I & Q).
    exists m'; split; auto. apply full_iff. intros o J. apply C in J. apply (Permutation_map fst) in Q.
    now apply (Permutation_in _ Q).
  - intros (m & I & F). apply states_sound in I as (pos & H & A); auto. exists pos, m. split; auto. split; auto.
    now apply full_iff.
Qed.

Lemma detected_states : forall s plans u, Forall lawful plans -> (Detected s plans u <->
  exists w v c, u = w ++ v /\ In c plans /\ existsb (full c) (states s c w) = true).
Proof.
  intros s plans u L; rewrite Forall_forall in L. split.
  - intros (w & v & sc & -> & (c & I & ->) & M). apply match_iff in M as (w1 & w2 & -> & W).
    exists w1, (w2 ++ v), c. rewrite app_assoc. repeat split; auto. apply whole_states; auto.
  - intros (w & v & c & -> & I & F). apply whole_states in F; auto.
    exists w, v, (denoted c); repeat split; [exists c; auto |].
    apply match_iff. exists w, []. rewrite app_nil_r; auto.
Qed.

Lemma left_states : forall s plans u, Forall lawful plans -> (Left s plans u <->
  exists c, In c plans /\ exists m, In m (states s c u) /\ full c m = false).
Proof.
  intros s plans u L; rewrite Forall_forall in L. split.
  - intros (sc & (c & I & ->) & pos & m & H & _ & [[C A] | (_ & _ & N)]); [| exfalso; simpl in N; auto].
    exists c; split; auto.
    destruct (states_complete s c (L c I) u pos m H A) as (m' & J & Q). exists m'; split; auto.
    apply not_true_is_false. rewrite full_iff. intros D; apply C. intros o K. apply D in K.
    apply Permutation_sym, (Permutation_map fst) in Q. now apply (Permutation_in _ Q).
  - intros (c & I & m & J & F). exists (denoted c); split; [exists c; auto |].
    apply states_sound in J as (pos & H & A); auto. exists pos, m. split; auto. split; [simpl; auto |]. left.
    split; auto.
    rewrite <- full_iff, F; discriminate.
Qed.

Lemma existsb_map : forall (A B : Type) (f : A -> B) p l, existsb p (map f l) = existsb (fun x => p (f x)) l.
Proof. induction l; simpl; congruence. Qed.

Lemma forallb_map : forall (A B : Type) (f : A -> B) p l, forallb p (map f l) = forallb (fun x => p (f x)) l.
Proof. induction l; simpl; congruence. Qed.

Lemma run_snoc : forall s plans u e, run s plans (u ++ [e]) = advance s (run s plans u) e.
Proof. intros; unfold run; now rewrite fold_left_app. Qed.

Definition snapshot s plans u := map (fun c => (c, states s c u)) plans.

Lemma snapshot_snoc : forall s plans u e, snapshot s plans (u ++ [e]) =
  map (fun x => (fst x, step s (fst x) e (snd x))) (snapshot s plans u).
Proof. intros; unfold snapshot. rewrite map_map. apply map_ext. intros; simpl. now rewrite states_snoc. Qed.

Lemma settle_snapshot : forall s plans u,
  settle (snapshot s plans u) =
  if existsb (fun c => existsb (full c) (states s c u)) plans then Done else Running (snapshot s plans u).
Proof. intros; unfold settle, snapshot. now rewrite existsb_map. Qed.

(** The monitor is done from the first detection on; before, it has all partial matches. *)
Lemma run_spec : forall s plans u,
  (run s plans u = Done /\ exists w v c, u = w ++ v /\ In c plans /\ existsb (full c) (states s c w) = true) \/
  (run s plans u = Running (snapshot s plans u) /\
   forall w v c, u = w ++ v -> In c plans -> existsb (full c) (states s c w) = false).
Proof.
  intros s plans u.
  assert (FALSE : forall u, existsb (fun c => existsb (full c) (states s c u)) plans = false ->
     forall c, In c plans -> existsb (full c) (states s c u) = false).
  { intros u' X c I. apply not_true_is_false; intros F.
    assert (existsb (fun c => existsb (full c) (states s c u')) plans = true); [| congruence].
    apply existsb_exists; eauto. }
  induction u as [| e u IH] using rev_ind.
  - change (run s plans []) with (settle (snapshot s plans [])). rewrite settle_snapshot.
    destruct (existsb _ plans) eqn:X.
    + left; split; auto. apply existsb_exists in X as (c & I & F). exists [], [], c; auto.
    + right; split; auto. intros w v c Q I. symmetry in Q; apply app_eq_nil in Q as [-> ->]. now apply FALSE.
  - rewrite run_snoc. destruct IH as [[-> (w & v & c & -> & I & F)] | [-> N]].
    + left; split; auto. exists w, (v ++ [e]), c. rewrite app_assoc; auto.
    + simpl. rewrite <- snapshot_snoc, settle_snapshot. destruct (existsb _ plans) eqn:X.
      * left; split; auto. apply existsb_exists in X as (c & I & F).
        exists (u ++ [e]), [], c. rewrite app_nil_r; auto.
      * right; split; auto. intros w v c Q I. destruct v as [| f v] using rev_ind.
        -- rewrite app_nil_r in Q; subst. now apply FALSE.
        -- clear IHv. rewrite app_assoc in Q. apply app_inj_tail in Q as [Q _]. now apply (N w v).
Qed.

(** For every list of scenarios, every trace and every semantics, the search gives the verdict of
    the definition. *)
Theorem verdict_correct : forall s plans u, Forall lawful plans -> Verdict s plans u (verdict_of (run s plans u)).
Proof.
  intros s plans u L. destruct (run_spec s plans u) as [[-> D] | [-> N]]; simpl.
  - now apply detected_states.
  - assert (ND : ~ Detected s plans u).
    { intros D. apply detected_states in D as (w & v & c & Q & I & F); auto. rewrite (N w v c Q I) in F; discriminate. }
    assert (NF : forall c m, In c plans -> In m (states s c u) -> full c m = false).
    { intros c m I J. apply not_true_is_false; intros F.
      assert (X := N u [] c (eq_sym (app_nil_r u)) I).
      rewrite (proj2 (existsb_exists _ _)) in X; [discriminate | eauto]. }
    unfold snapshot; rewrite forallb_map; simpl.
    destruct (forallb _ plans) eqn:B; simpl; (split; [exact ND |]).
    + intros F. apply left_states in F as (c & I & m & J & F); auto.
      rewrite forallb_forall in B. specialize (B c I). destruct (states s c u); [destruct J | discriminate B].
    + apply left_states; auto.
      assert (X : exists c, In c plans /\ is_nil (states s c u) = false).
      { clear - B. induction plans as [| c plans IH]; simpl in B; [discriminate |].
        destruct (is_nil (states s c u)) eqn:X; [| exists c; simpl; auto].
        destruct (IH B) as (c' & I & Y). exists c'; simpl; auto. }
      destruct X as (c & I & X). exists c; split; auto.
      destruct (states s c u) as [| m l] eqn:Y; [discriminate |].
      exists m; simpl; split; auto. apply (NF c); auto. rewrite Y; simpl; auto.
Qed.

End Search.
Arguments plan E : clear implicits.
Arguments monitor E : clear implicits.
