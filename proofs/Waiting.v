(** * The search where other positions of the trace count

    A scenario may say what the trace must not have at other positions.  The search keeps the trace and,
    with each partial match, the positions of its events; it drops partial matches that are broken, and
    keeps complete ones that wait for a decision.  It knows what breaks and decides as two Boolean tests,
    with two laws: the order of an assignment is irrelevant, and what is broken stays broken. *)

Require Import List Bool Arith Lia Permutation.
Require Import RVAFT.Language RVAFT.Definition RVAFT.Search.
Import ListNotations.

Section Waiting.
Context {E : Type}.
Variable relevant : E -> bool.

(** An assignment whose events have their positions. *)
Definition placed := assigned (nat * E).

Definition forget (m : placed) : assigned E := map (fun x => (fst x, snd (snd x))) m.
Definition place (k : nat) (position : occurrence -> nat) (m : assigned E) : placed :=
  map (fun x => (fst x, (k + position (fst x), snd x))) m.
Definition numbered (k : nat) (u : list E) : list (nat * E) := combine (seq k (length u)) u.

Record watched := Watched {
  watched_plan : plan E;
  is_unbroken : list E -> placed -> bool;
  is_decided : list E -> placed -> bool }.

(** The scenario after some events of the past. *)
Definition denoted_after (past : list E) (q : watched) : scenario E :=
  let c := denoted (watched_plan q) in
  Scenario E (occurrences c) (before c) (consistent c)
    (fun u position m => is_unbroken q (past ++ u) (place (length past) position m) = true)
    (fun u position m => is_decided q (past ++ u) (place (length past) position m) = true).

(** Each event of the assignment is at its position. *)
Definition InTrace (h : list E) (m : placed) : Prop := forall o k e, In (o, (k, e)) m -> nth_error h k = Some e.

Record watchable (q : watched) : Prop := {
  watched_lawful : lawful (watched_plan q);
  unbroken_any_order : forall h m m', NoDup (domain m) -> Permutation m m' -> is_unbroken q h m = is_unbroken q h m';
  decided_any_order : forall h m m', NoDup (domain m) -> Permutation m m' -> is_decided q h m = is_decided q h m';
  broken_stays : forall h e m m', NoDup (domain m') -> InTrace h m ->
    (m' = m \/ exists o, m' = (o, (length h, e)) :: m) ->
    is_unbroken q (h ++ [e]) m' = true -> is_unbroken q h m = true }.

(** ** Assignments with positions *)

Definition lifted (c : plan E) : plan (nat * E) :=
  Plan (plan_occurrences c) (plan_before c) (fun m => plan_consistent c (forget m)).

Lemma forget_domain : forall m, domain (forget m) = domain m.
Proof. intros m. unfold domain, forget. now rewrite map_map. Qed.

Lemma place_domain : forall k position m, domain (place k position m) = domain m.
Proof. intros k position m. unfold domain, place. now rewrite map_map. Qed.

Lemma forget_place : forall k position m, forget (place k position m) = m.
Proof.
  intros k position m. unfold forget, place. rewrite map_map. rewrite <- (map_id m) at 2. apply map_ext.
  now intros [o e].
Qed.

Lemma nth_numbered : forall u k i j e, nth_error (numbered k u) i = Some (j, e) <->
  j = k + i /\ nth_error u i = Some e.
Proof.
  unfold numbered; induction u as [| f u IH]; intros k i j e.
  - destruct i; simpl; (split; [discriminate | intros [_ H]; discriminate]).
  - destruct i as [| i]; simpl.
    + rewrite Nat.add_0_r. split; [intros H; injection H as <- <-; auto | intros [-> H]; congruence].
    + rewrite IH. split; intros [-> H]; (split; [lia | auto]).
Qed.

Lemma numbered_snoc : forall k u e, numbered k (u ++ [e]) = numbered k u ++ [(k + length u, e)].
Proof.
  intros k u e. unfold numbered. rewrite app_length, seq_app. simpl.
  revert k; induction u as [| f u IH]; intros k; simpl; [now rewrite Nat.add_0_r |].
  f_equal. rewrite <- Nat.add_succ_comm. apply IH.
Qed.

Lemma numbered_length : forall k u, length (numbered k u) = length u.
Proof. intros k u. unfold numbered. rewrite combine_length, seq_length. lia. Qed.

Lemma numbered_app : forall k u v, exists v', numbered k (u ++ v) = numbered k u ++ v'.
Proof.
  intros k u v; induction v as [| e v IH] using rev_ind; [exists []; now rewrite !app_nil_r |].
  destruct IH as [v' IH]. exists (v' ++ [(k + length (u ++ v), e)]).
  now rewrite app_assoc, numbered_snoc, IH, app_assoc.
Qed.

Lemma same_partial : forall past q u pos m, Partial (denoted_after past q) u pos m <->
  Partial (denoted (watched_plan q)) u pos m.
Proof. intros; split; intros []; constructor; auto. Qed.

Lemma partial_forget : forall c k u pos m, Partial (denoted (lifted c)) (numbered k u) pos m ->
  Partial (denoted c) u pos (forget m) /\ m = place k pos (forget m).
Proof.
  intros c k u pos m [ON OF AT NT DC PK CH]. split.
  - constructor; rewrite ?forget_domain; auto. intros o e I. unfold forget in I.
    apply in_map_iff in I as ([o' [j e']] & Q & I). simpl in Q. injection Q as -> ->. apply AT in I.
    now apply nth_numbered in I.
  - unfold place, forget. rewrite map_map. rewrite <- (map_id m) at 1. apply map_ext_in. intros [o [j e]] I.
    apply AT, nth_numbered in I as [-> _]. reflexivity.
Qed.

Lemma partial_place : forall c k u pos m, Partial (denoted c) u pos m ->
  Partial (denoted (lifted c)) (numbered k u) pos (place k pos m).
Proof.
  intros c k u pos m [ON OF AT NT DC PK CH]. constructor; rewrite ?place_domain; auto.
  - intros o [j e] I. apply in_map_iff in I as ([o' e'] & Q & I). simpl in Q. injection Q as -> <- ->.
    apply nth_numbered. split; auto.
  - simpl. rewrite forget_place. exact CH.
Qed.

Lemma lifted_lawful : forall c, lawful c -> lawful (lifted c).
Proof.
  intros c [A B]. constructor; simpl.
  - intros m m' N P. apply A; [now rewrite forget_domain | now apply Permutation_map].
  - intros [o [k e]] m N H. apply (B (o, e)); auto. simpl. now rewrite forget_domain.
Qed.

Lemma at_place : forall past c u pos m, Partial (denoted c) u pos m ->
  InTrace (past ++ u) (place (length past) pos m).
Proof.
  intros past c u pos m P o k e I. apply in_map_iff in I as ([o' e'] & Q & I). simpl in Q. injection Q as -> <- ->.
  apply (at_positions _ _ _ _ P) in I. rewrite nth_error_app2 by lia. now replace (_ + _ - _) with (pos o) by lia.
Qed.

(** ** The states of the search *)

Notation Rel := (fun e => relevant e = true).
Notation lifted_relevant := (fun x : nat * E => relevant (snd x)).
Notation PlacedRel := (fun x : nat * E => lifted_relevant x = true).

Definition placed_states (s : semantics) (q : watched) (k : nat) (u : list E) : list placed :=
  states lifted_relevant s (lifted (watched_plan q)) (numbered k u).

Lemma placed_positions : forall s k u used,
  (match_positions PlacedRel s (numbered k u) used <-> match_positions Rel s u used) /\
  (partial_positions PlacedRel s (numbered k u) used <-> partial_positions Rel s u used).
Proof.
  intros s k u used. apply positions_same; [apply numbered_length | | reflexivity]. intros i. split.
  - intros ([j e] & N & R). apply nth_numbered in N as [_ N]. exists e; auto.
  - intros (e & N & R). exists (k + i, e). split; auto. now apply nth_numbered.
Qed.

Lemma placed_sound : forall s q past u m, watchable q -> In m (placed_states s q (length past) u) ->
  exists pos, Partial (denoted (watched_plan q)) u pos (forget m) /\
    partial_positions Rel s u (Used pos (forget m)) /\
    m = place (length past) pos (forget m) /\ InTrace (past ++ u) m /\ NoDup (domain m).
Proof.
  intros s q past u m W I. apply states_sound in I as (pos & P & A); [| apply lifted_lawful, W].
  destruct (partial_forget _ _ _ _ _ P) as [P' Q]. exists pos. split; [auto | split; [| split; [auto | split]]].
  - apply placed_positions in A. assert (U : forall i, Used pos (forget m) i <-> Used pos m i)
      by (intros i; unfold Used; now rewrite forget_domain).
    destruct s; simpl in *; auto; [intros i; now rewrite U | intros i; now rewrite U |].
    destruct A as [j A]. exists j. intros i; now rewrite U.
  - rewrite Q. eapply at_place; eauto.
  - apply (once _ _ _ _ P).
Qed.

Lemma placed_complete : forall s q k u pos m, watchable q -> Partial (denoted (watched_plan q)) u pos m ->
  partial_positions Rel s u (Used pos m) ->
  exists m', In m' (placed_states s q k u) /\ Permutation (place k pos m) m'.
Proof.
  intros s q k u pos m W P A. apply states_complete with (pos := pos);
    [apply lifted_lawful, W | now apply partial_place |].
  apply placed_positions. assert (U : forall i, Used pos (place k pos m) i <-> Used pos m i)
    by (intros i; unfold Used; now rewrite place_domain).
  destruct s; simpl in *; auto; [intros i; now rewrite U | intros i; now rewrite U |].
  destruct A as [j A]. exists j. intros i; now rewrite U.
Qed.

Lemma full_same : forall q (m m' : placed), Permutation m m' -> full (lifted (watched_plan q)) m =
  full (lifted (watched_plan q)) m'.
Proof.
  intros q m m' P. apply eq_true_iff_eq. rewrite !full_iff. apply (Permutation_map fst) in P.
  split; intros H o I; apply H in I; [| apply Permutation_sym in P]; now apply (Permutation_in _ P).
Qed.

Lemma full_forget : forall q m, full (lifted (watched_plan q)) m = true <->
  complete (denoted (watched_plan q)) (forget m).
Proof. intros q m. rewrite full_iff. unfold complete. rewrite forget_domain. reflexivity. Qed.

(** ** The monitor *)

(** Of a scenario, the partial matches that are not broken, and the complete ones. *)
Definition tracks := (list placed * list placed)%type.

Definition sorted (q : watched) (h : list E) (l waiting : list placed) : tracks :=
  let kept := filter (is_unbroken q h) l in
  (filter (fun m => negb (full (lifted (watched_plan q)) m)) kept,
   filter (full (lifted (watched_plan q))) kept ++ filter (is_unbroken q h) waiting).

Inductive watch := Ended (h : list E) | Watching (h : list E) (l : list (watched * tracks)).

Definition settle (h : list E) (l : list (watched * tracks)) : watch :=
  if existsb (fun x => existsb (is_decided (fst x) h) (snd (snd x))) l then Ended h else Watching h l.

Definition watch_init (past : list E) (qs : list watched) : watch :=
  settle past (map (fun q => (q, sorted q past (start (lifted (watched_plan q))) [])) qs).

Definition watch_advance (s : semantics) (x : watch) (e : E) : watch :=
  match x with
  | Ended h => Ended (h ++ [e])
  | Watching h l =>
    let k := length h in
    let h := h ++ [e] in
    settle h (map (fun y => (fst y, sorted (fst y) h
      (step lifted_relevant s (lifted (watched_plan (fst y))) (k, e) (fst (snd y))) (snd (snd y)))) l)
  end.

Definition watch_verdict (x : watch) : verdict :=
  match x with
  | Ended _ => Top
  | Watching _ l => if forallb (fun y => is_nil (fst (snd y)) && is_nil (snd (snd y))) l then Bottom else Unknown
  end.

Definition watch_run s past qs (u : list E) : watch := fold_left (watch_advance s) u (watch_init past qs).

(** *** What it keeps *)

Definition Kept s q past u m : Prop :=
  In m (placed_states s q (length past) u) /\ full (lifted (watched_plan q)) m = false /\
  is_unbroken q (past ++ u) m = true.
Definition Waits s q past u m : Prop :=
  (exists w v, u = w ++ v /\ In m (placed_states s q (length past) w)) /\
  full (lifted (watched_plan q)) m = true /\ is_unbroken q (past ++ u) m = true.

Definition Tracks s q past u (x : tracks) : Prop :=
  (forall m, In m (fst x) <-> Kept s q past u m) /\ (forall m, In m (snd x) <-> Waits s q past u m).

Lemma tracks_start : forall s q past, Tracks s q past [] (sorted q past (start (lifted (watched_plan q))) []).
Proof.
  intros s q past. unfold sorted. split; intros m; simpl; rewrite ?app_nil_r, !filter_In.
  - unfold Kept. rewrite app_nil_r, negb_true_iff. unfold placed_states; simpl. tauto.
  - unfold Waits. rewrite app_nil_r. split.
    + intros [[I U] F]. split; [exists [], []; auto | auto].
    + intros [(w & v & Q & I) [F U]]. symmetry in Q. apply app_eq_nil in Q as [-> ->]. auto.
Qed.

Section Step.
Variable s : semantics.
Variable q : watched.
Hypothesis W : watchable q.
Notation c := (lifted (watched_plan q)).

(** A state after an event is one before it, an extension of one, or new. *)
Lemma step_cases : forall x l m, In m (step lifted_relevant s c x l) <->
  (In m l /\ (s = Scattered \/ (s <> Strict /\ lifted_relevant x = false))) \/
  ((exists m0, In m0 l /\ In m (extend c x m0)) /\
     (s = Strict \/ s = Scattered \/ lifted_relevant x = true)) \/
  (In m (start c) /\ s = Consecutive /\ lifted_relevant x = true).
Proof.
  intros x l m. unfold step. destruct s;
    [| destruct (lifted_relevant x) eqn:R | destruct (lifted_relevant x) eqn:R |];
    rewrite ?in_app_iff, ?in_flat_map; intuition (congruence || eauto).
Qed.

Lemma extended_full : forall x m0 m, In m (extend c x m0) -> full c m0 = false.
Proof.
  intros x m0 m I. apply (in_extend lifted_relevant) in I as (o & _ & O & N & _).
  apply not_true_is_false. rewrite full_iff. intros F. apply N, F, O.
Qed.

Lemma tracks_step : forall past u e x, Tracks s q past u x ->
  Tracks s q past (u ++ [e])
    (sorted q ((past ++ u) ++ [e]) (step lifted_relevant s c (length (past ++ u), e) (fst x)) (snd x)).
Proof.
  intros past u e [kept waiting] [TK TW]. simpl in TK, TW.
  assert (ST : placed_states s q (length past) (u ++ [e]) =
    step lifted_relevant s c (length (past ++ u), e) (placed_states s q (length past) u)).
  { unfold placed_states. now rewrite numbered_snoc, states_snoc, app_length. }
  (* what is not broken after the event was not broken before *)
  assert (BACK : forall m m', In m (placed_states s q (length past) u) -> NoDup (domain m') ->
    (m' = m \/ In m' (extend c (length (past ++ u), e) m)) ->
    is_unbroken q ((past ++ u) ++ [e]) m' = true -> is_unbroken q (past ++ u) m = true).
  { intros m m' I N X. apply placed_sound with (past := past) in I as (pos & _ & _ & _ & A & _); auto.
    apply (broken_stays q W); auto. destruct X as [X | X]; auto.
    right. apply (in_extend lifted_relevant) in X as (o & -> & _). eauto. }
  assert (ND : forall m, In m (placed_states s q (length past) (u ++ [e])) -> NoDup (domain m)).
  { intros m I. apply placed_sound with (past := past) in I as (pos & _ & _ & _ & _ & N); auto. }
  assert (NEW : forall m, is_unbroken q ((past ++ u) ++ [e]) m = true ->
    In m (step lifted_relevant s c (length (past ++ u), e) kept) ->
    In m (placed_states s q (length past) (u ++ [e]))).
  { intros m U I. rewrite ST. apply step_cases in I. apply step_cases.
    destruct I as [[I X] | [[(m0 & I & J) X] | I]]; auto.
    - left. split; auto. now apply TK.
    - right; left. split; auto. exists m0; split; auto. now apply TK. }
  assert (OLD : forall m, is_unbroken q ((past ++ u) ++ [e]) m = true ->
    In m (placed_states s q (length past) (u ++ [e])) ->
    In m (step lifted_relevant s c (length (past ++ u), e) kept) \/
    (full c m = true /\ In m waiting)).
  { intros m U I. assert (N := ND m I). rewrite ST in I. apply step_cases in I.
    destruct I as [[I X] | [[(m0 & I & J) X] | I]].
    - destruct (full c m) eqn:F.
      + right. split; auto. apply TW. split; [exists u, []; now rewrite app_nil_r | split; auto].
        apply (BACK m m); auto.
      + left. apply step_cases. left. split; auto. apply TK. split; [auto | split; auto]. apply (BACK m m); auto.
    - left. apply step_cases. right; left. split; auto. exists m0; split; auto. apply TK. split; [auto |].
      split; [eapply extended_full; eauto | apply (BACK m0 m); auto].
    - left. apply step_cases. auto. }
  unfold sorted. split; intros m; simpl; rewrite ?in_app_iff, !filter_In.
  - unfold Kept. rewrite app_assoc, negb_true_iff. split.
    + intros [[I U] F]. auto.
    + intros (I & F & U). destruct (OLD m U I) as [H | [H _]]; [auto | congruence].
  - unfold Waits. rewrite app_assoc. split.
    + intros [[[I U] F] | [I U]].
      * split; [exists (u ++ [e]), []; rewrite app_nil_r; auto | auto].
      * apply TW in I as [(w & v & -> & I) [F _]]. split; [| auto]. exists w, (v ++ [e]). rewrite app_assoc; auto.
    + intros [(w & v & Q & I) [F U]]. destruct v as [| f v] using rev_ind.
      * rewrite app_nil_r in Q. subst w. destruct (OLD m U I) as [H | [_ H]]; auto.
      * clear IHv. rewrite app_assoc in Q. apply app_inj_tail in Q as [-> <-]. right. split; auto. apply TW.
        split; [exists w, v; auto | split; auto].
        assert (J := I). apply placed_sound with (past := past) in J as (pos & P & _ & PL & _ & N); auto.
        assert (IT : InTrace (past ++ w ++ v) m).
        { rewrite PL. apply at_place with (c := watched_plan q). now apply partial_app. }
        apply (broken_stays q W (past ++ w ++ v) e m m N IT); auto.
Qed.
End Step.

(** ** The verdict *)

Definition ScenariosAfter (past : list E) (qs : list watched) (sc : scenario E) : Prop :=
  exists q, In q qs /\ sc = denoted_after past q.

Lemma match_waits : forall s past q u, watchable q -> (Match Rel s (denoted_after past q) u <->
  exists m, Waits s q past u m /\ is_decided q (past ++ u) m = true).
Proof.
  intros s past q u W. split.
  - intros (pos & m & P & C & M & U & D). apply same_partial in P.
    destruct (match_prefix relevant s (watched_plan q) u pos m P M) as (w & v & -> & P' & A).
    destruct (placed_complete s q (length past) w pos m W P' A) as (m' & I & PM).
    assert (N : NoDup (domain (place (length past) pos m))) by (rewrite place_domain; apply (once _ _ _ _ P)).
    exists m'. split.
    + split; [exists w, v; auto | split].
      * rewrite <- (full_same q _ _ PM). apply full_forget. now rewrite forget_place.
      * rewrite <- (unbroken_any_order q W _ _ _ N PM). exact U.
    + rewrite <- (decided_any_order q W _ _ _ N PM). exact D.
  - intros (m & [(w & v & -> & I) [F U]] & D).
      apply placed_sound with (past := past) in I as (pos & P & A & Q & _); auto.
    destruct (prefix_match relevant s (watched_plan q) w v pos (forget m) P A) as [P' M].
    exists pos, (forget m). split; [now apply same_partial |]. split; [now apply full_forget |]. split; [auto |].
    simpl. now rewrite <- Q.
Qed.

Lemma left_waits : forall s past q u, watchable q -> (PartialMatch Rel s (denoted_after past q) u <->
  (exists m, Kept s q past u m) \/ exists m, Waits s q past u m /\ is_decided q (past ++ u) m = false).
Proof.
  intros s past q u W. split.
  - intros (pos & m & P & U & H). apply same_partial in P.
    assert (N : NoDup (domain (place (length past) pos m))) by (rewrite place_domain; apply (once _ _ _ _ P)).
    destruct H as [[C A] | (C & M & D)].
    + left. destruct (placed_complete s q (length past) u pos m W P A) as (m' & I & PM). exists m'.
      split; [auto | split].
      * rewrite <- (full_same q _ _ PM). apply not_true_is_false. rewrite full_forget, forget_place. exact C.
      * rewrite <- (unbroken_any_order q W _ _ _ N PM). exact U.
    + right. destruct (match_prefix relevant s (watched_plan q) u pos m P M) as (w & v & -> & P' & A).
      destruct (placed_complete s q (length past) w pos m W P' A) as (m' & I & PM). exists m'. split.
      * split; [exists w, v; auto | split].
        -- rewrite <- (full_same q _ _ PM). apply full_forget. now rewrite forget_place.
        -- rewrite <- (unbroken_any_order q W _ _ _ N PM). exact U.
      * rewrite <- (decided_any_order q W _ _ _ N PM). now apply not_true_is_false.
  - intros [(m & I & F & U) | (m & [(w & v & -> & I) [F U]] & D)];
      apply placed_sound with (past := past) in I as (pos & P & A & Q & _); auto; exists pos, (forget m).
    + split; [now apply same_partial |]. split; [simpl; now rewrite <- Q |]. left. split; auto.
      intros C. apply full_forget in C. congruence.
    + destruct (prefix_match relevant s (watched_plan q) w v pos (forget m) P A) as [P' M].
      split; [now apply same_partial |]. split; [simpl; now rewrite <- Q |]. right. split; [now apply full_forget |].
      split; auto. simpl. rewrite <- Q, D. discriminate.
Qed.

Lemma run_watch : forall s past qs, Forall watchable qs -> forall u,
  (watch_run s past qs u = Ended (past ++ u) /\ Detected Rel (ScenariosAfter past qs) s u) \/
  (exists l, watch_run s past qs u = Watching (past ++ u) l /\ map fst l = qs /\
     Forall (fun y => Tracks s (fst y) past u (snd y)) l /\ ~ Detected Rel (ScenariosAfter past qs) s u).
Proof.
  intros s past qs W. rewrite Forall_forall in W.
  (* what [settle] does with the tracks of all scenarios *)
  assert (SET : forall u l, map fst l = qs -> Forall (fun y => Tracks s (fst y) past u (snd y)) l ->
    (forall w v, u = w ++ v -> v <> [] -> ~ Detected Rel (ScenariosAfter past qs) s w) ->
    (settle (past ++ u) l = Ended (past ++ u) /\ Detected Rel (ScenariosAfter past qs) s u) \/
    (settle (past ++ u) l = Watching (past ++ u) l /\ ~ Detected Rel (ScenariosAfter past qs) s u)).
  { intros u l Q T N. rewrite Forall_forall in T. unfold settle.
    destruct (existsb (fun x => existsb (is_decided (fst x) (past ++ u)) (snd (snd x))) l) eqn:X;
      [left | right]; (split; [auto |]).
    - apply existsb_exists in X as ([q x] & I & X). apply existsb_exists in X as (m & J & D). simpl in *.
      assert (IQ : In q qs) by (rewrite <- Q; apply in_map_iff; exists (q, x); auto).
      exists u, [], (denoted_after past q). rewrite app_nil_r. split; [auto | split; [exists q; auto |]].
      apply match_waits; auto. exists m. split; auto. now apply (T _ I).
    - intros (w & v & sc & -> & (q & IQ & ->) & M). destruct v as [| f v].
      + rewrite app_nil_r in *. apply match_waits in M as (m & J & D); auto. rewrite <- Q in IQ.
        apply in_map_iff in IQ as ([q' x] & Z & I). simpl in Z. subst q'. apply (T _ I) in J. simpl in J.
        rewrite <- not_true_iff_false in X. apply X, existsb_exists. exists (q, x). split; auto.
        apply existsb_exists. eauto.
      + apply (N w (f :: v) eq_refl); [discriminate |]. exists w, [], (denoted_after past q). rewrite app_nil_r.
        split; [auto | split; [exists q; auto | auto]]. }
  induction u as [| e u IH] using rev_ind.
  - destruct (SET [] (map (fun q => (q, sorted q past (start (lifted (watched_plan q))) [])) qs)) as [[A B] | [A B]].
    + rewrite map_map. apply map_id.
    + apply Forall_forall. intros y I. apply in_map_iff in I as (q & <- & I). apply tracks_start.
    + intros w v Q NE. symmetry in Q. apply app_eq_nil in Q as [_ Q]. contradiction.
    + left. rewrite app_nil_r in *. auto.
    + right. rewrite app_nil_r in *. eexists. split; [exact A |]. split; [rewrite map_map; apply map_id |].
      split; auto.
      apply Forall_forall. intros y I. apply in_map_iff in I as (q & <- & I). apply tracks_start.
  - unfold watch_run. rewrite fold_left_app. fold (watch_run s past qs u). cbn [fold_left].
    destruct IH as [[-> D] | (l & -> & Q & T & N)].
    + left. simpl. rewrite app_assoc. split; auto. destruct D as (w & v & sc & -> & D). exists w, (v ++ [e]), sc.
      rewrite app_assoc; auto.
    + cbn [watch_advance]. match goal with |- context [settle _ ?x] => set (l' := x) end. rewrite <- app_assoc.
      assert (QL : map fst l' = qs) by (unfold l'; rewrite map_map; simpl; exact Q).
      assert (TL : Forall (fun y => Tracks s (fst y) past (u ++ [e]) (snd y)) l').
      { apply Forall_forall. intros y I. apply in_map_iff in I as ([q x] & <- & I). simpl.
        rewrite Forall_forall in T. apply tracks_step; [| apply (T _ I)]. apply W. rewrite <- Q. apply in_map_iff.
        exists (q, x); auto. }
      destruct (SET (u ++ [e]) l' QL TL) as [[A B] | [A B]]; [| auto |].
      * intros w v Z NE D. destruct v as [| f v] using rev_ind; [contradiction |]. clear IHv.
        rewrite app_assoc in Z. apply app_inj_tail in Z as [-> _]. apply N.
        destruct D as (w' & v' & sc & -> & D). exists w', (v' ++ v), sc. rewrite app_assoc; auto.
      * right. exists l'. auto.
Qed.

(** For every list of scenarios, every trace and every semantics, the search gives the verdict of the
    definition. *)
Theorem watch_correct : forall s past qs u, Forall watchable qs ->
  Verdict Rel (ScenariosAfter past qs) s u (watch_verdict (watch_run s past qs u)).
Proof.
  intros s past qs u W. destruct (run_watch s past qs W u) as [[-> D] | (l & -> & Q & T & N)]; simpl; auto.
  rewrite Forall_forall in T, W.
  assert (Z : Left Rel (ScenariosAfter past qs) s u <->
    exists q x, In (q, x) l /\ is_nil (fst x) && is_nil (snd x) = false).
  { split.
    - intros (sc & (q & IQ & ->) & P). rewrite <- Q in IQ. apply in_map_iff in IQ as ([q' x] & Z & I). simpl in Z.
      subst q'. exists q, x. split; auto. apply not_true_is_false. intros B. apply andb_true_iff in B as [B C].
      apply is_nil_iff in B, C. assert (IQ : In q qs) by (rewrite <- Q; apply in_map_iff; exists (q, x); auto).
      destruct (T _ I) as [TK TW]. simpl in TK, TW. apply left_waits in P as [(m & K) | (m & K & _)]; auto.
      + apply TK in K. rewrite B in K. destruct K.
      + apply TW in K. rewrite C in K. destruct K.
    - intros (q & x & I & B). assert (IQ : In q qs) by (rewrite <- Q; apply in_map_iff; exists (q, x); auto).
      destruct (T _ I) as [TK TW]. simpl in TK, TW. exists (denoted_after past q). split; [exists q; auto |].
      apply left_waits; auto. destruct x as [[| m k] w]; simpl in *.
      + destruct w as [| m w]; [discriminate |]. right. exists m.
        assert (K : Waits s q past u m) by (apply TW; simpl; auto).
        split; auto. apply not_true_is_false. intros D. apply N. exists u, [], (denoted_after past q).
        rewrite app_nil_r. split; [auto | split; [exists q; auto |]]. apply match_waits; eauto.
      + left. exists m. apply TK. auto. }
  destruct (forallb (fun y => is_nil (fst (snd y)) && is_nil (snd (snd y))) l) eqn:B; simpl; (split; [exact N |]).
  - rewrite Z. intros (q & x & I & C). rewrite forallb_forall in B. specialize (B _ I). simpl in B. congruence.
  - apply Z. clear - B. induction l as [| [q x] l IH]; [discriminate |]. simpl in B.
    destruct (is_nil (fst x) && is_nil (snd x)) eqn:C; [| exists q, x; simpl; auto].
    destruct (IH B) as (q' & x' & I & D). exists q', x'. simpl; auto.
Qed.

(** *** The end of the trace *)

(** Every clause is decided: a complete match that waits is one. *)
Definition watch_finish (x : watch) : watch :=
  match x with
  | Ended h => Ended h
  | Watching h l => if forallb (fun y => is_nil (snd (snd y))) l then x else Ended h
  end.

Lemma match_at_end : forall s past q u, watchable q ->
  (Match Rel s (at_end (denoted_after past q)) u <-> exists m, Waits s q past u m).
Proof.
  intros s past q u W. set (q' := Watched (watched_plan q) (is_unbroken q) (fun _ _ => true)).
  assert (W' : watchable q') by (destruct W; constructor; auto).
  transitivity (Match Rel s (denoted_after past q') u).
  - split; intros (pos & m & P & C & M & U & _); exists pos, m; (split; [destruct P; constructor; auto |]);
      (split; [exact C |]); (split; [exact M |]); (split; [exact U |]); [reflexivity | exact I].
  - rewrite (match_waits s past q' u W'). split; [intros (m & H & _) | intros (m & H)]; exists m; auto.
Qed.

Theorem finish_correct : forall s past qs u, Forall watchable qs ->
  VerdictAtEnd Rel (ScenariosAfter past qs) s u (watch_verdict (watch_finish (watch_run s past qs u))).
Proof.
  intros s past qs u W. assert (V := watch_correct s past qs u W).
  destruct (run_watch s past qs W u) as [[R D] | (l & R & Q & T & N)]; rewrite R in *; [left; exact D |].
  rewrite Forall_forall in T, W. cbn [watch_finish].
  assert (IN : forall q x, In (q, x) l -> In q qs /\ (forall m, In m (snd x) <-> Waits s q past u m)).
  { intros q x I. split; [rewrite <- Q; apply in_map_iff; exists (q, x); auto | apply (T _ I)]. }
  destruct (forallb (fun y => is_nil (snd (snd y))) l) eqn:X.
  - assert (NE : ~ DetectedAtEnd Rel (ScenariosAfter past qs) s u).
    { intros [D | (sc & (q & I & ->) & M)]; [contradiction |]. apply match_at_end in M as (m & H); auto.
      rewrite <- Q in I. apply in_map_iff in I as ([q' x] & Z & I). simpl in Z. subst q'.
      rewrite forallb_forall in X. assert (Y := X _ I). apply is_nil_iff in Y. simpl in Y. apply (IN q x I) in H.
      rewrite Y in H. destruct H. }
    destruct (watch_verdict (Watching (past ++ u) l)) eqn:Z.
    + contradiction.
    + split; [exact NE | apply V].
    + split; [exact NE | apply V].
  - right. assert (E' : exists q x, In (q, x) l /\ is_nil (snd x) = false).
    { clear - X. induction l as [| [q x] l IH]; [discriminate |]. simpl in X.
      destruct (is_nil (snd x)) eqn:Z; [| exists q, x; simpl; auto]. destruct (IH X) as (q' & x' & I & H).
      exists q', x'. simpl; auto. }
    destruct E' as (q & x & I & Z). destruct (IN q x I) as [IQ H]. exists (denoted_after past q).
    split; [exists q; auto |]. apply match_at_end; auto. destruct (snd x) as [| m k]; [discriminate |].
    exists m. apply H. simpl; auto.
Qed.

Lemma ended_iff : forall s past qs u, Forall watchable qs ->
  (watch_run s past qs u = Ended (past ++ u) <-> Detected Rel (ScenariosAfter past qs) s u).
Proof.
  intros s past qs u W. destruct (run_watch s past qs W u) as [[-> D] | (l & -> & _ & _ & N)]; [tauto |].
  split; [discriminate | contradiction].
Qed.
End Waiting.
Arguments watched E : clear implicits.
Arguments placed E : clear implicits.
Arguments watch E : clear implicits.
