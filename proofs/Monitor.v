(** * The monitor of a tree, and its theorem

    [monitor_correct]: after every trace the monitor of a tree gives the verdict that the definition
    gives.  [repeated_correct]: so it is when monitoring starts afresh after each detection. *)

Require Import List Bool Arith ZArith Lia Permutation.
Require Import RVAFT.Values RVAFT.Language RVAFT.Definition RVAFT.Search RVAFT.Conditions RVAFT.Scenarios
  RVAFT.Waiting RVAFT.Absences RVAFT.Pruning RVAFT.Keys.
Import ListNotations.

(** ** Late events *)

Definition greatest (seen : option Z) (time : option Z) : option Z :=
  match seen, time with
  | Some a, Some b => Some (Z.max a b)
  | None, time => time
  | seen, None => seen
  end.

Definition is_late (d : option Z) (seen time : option Z) : bool :=
  match d, seen, time with Some d, Some a, Some b => Z.ltb (b + d) a | _, _, _ => false end.

(** An event with its mark, by the greatest time before it. *)
Definition mark (d seen : option Z) (v : value) (z : option Z) : event := Event v z (is_late d seen z).

(** The trace of a log. *)
Fixpoint stamp (d : option Z) (seen : option Z) (log : list (value * option Z)) : list event :=
  match log with
  | [] => []
  | (v, z) :: log => mark d seen v z :: stamp d (greatest seen z) log
  end.

Definition trace_of (t : tree) (log : list (value * option Z)) : list event := stamp (lateness t) None log.

Definition greatest_of (seen : option Z) (log : list (value * option Z)) : option Z :=
  fold_left (fun a x => greatest a (snd x)) log seen.

Lemma stamp_nth : forall d log seen i e, nth_error (stamp d seen log) i = Some e ->
  nth_error log i = Some (content e, time_of e) /\
  late e = is_late d (greatest_of seen (firstn i log)) (time_of e).
Proof.
  induction log as [| [v z] log IH]; intros seen i e H; [destruct i; discriminate |].
  destruct i as [| i]; simpl in *.
  - injection H as <-; auto.
  - apply IH in H as [A B]. auto.
Qed.

Lemma greatest_before : forall log seen z,
  greatest_of seen log = Some z ->
  (seen = Some z \/ exists j v, nth_error log j = Some (v, Some z)) /\
  (forall y, seen = Some y -> (y <= z)%Z) /\
  (forall j v y, nth_error log j = Some (v, Some y) -> (y <= z)%Z).
Proof.
  induction log as [| [v w] log IH]; intros seen z H; simpl in H.
  - subst. split; auto. split; [intros y Q; injection Q as <-; lia | intros [| j] w y Q; discriminate].
  - apply IH in H as (A & B & C). split; [| split].
    + destruct A as [A | (j & x & A)]; [| right; exists (S j), x; auto].
      destruct seen as [a |], w as [b |]; simpl in A; auto; try discriminate.
      * injection A as A. destruct (Z.max_spec a b) as [[_ Q] | [_ Q]]; rewrite Q in A; subst; auto.
        right; exists 0, v; auto.
      * right; exists 0, v; simpl; congruence.
    + intros y ->. destruct w as [b |]; simpl in B; [specialize (B _ eq_refl); lia | auto].
    + intros [| j] x y Q; simpl in Q; [| eapply C; eauto]. injection Q; intros; subst.
      destruct seen as [a |]; simpl in B; [specialize (B _ eq_refl); lia | auto].
Qed.

Lemma no_greatest : forall log seen, greatest_of seen log = None ->
  forall j v y, nth_error log j <> Some (v : value, Some y).
Proof.
  induction log as [| [v w] log IH]; intros seen H [| j] x y Q; simpl in *; try discriminate.
  - injection Q; intros; subst.
    assert (X : exists a, greatest seen (Some y) = Some a) by (destruct seen; simpl; eauto).
    destruct X as [a X]. rewrite X in H. clear - H. revert a H.
    induction log as [| [u w] log IH]; intros a H; simpl in H; [discriminate |].
    destruct w; simpl in H; eauto.
  - eapply IH; eauto.
Qed.

Theorem trace_of_correct : forall t log, TraceOf t log (trace_of t log).
Proof.
  intros t log. unfold trace_of. split.
  - generalize (None : option Z) as seen. induction log as [| [v z] log IH]; simpl; intros seen; auto.
  - intros i e H. apply stamp_nth in H as [A B]. split; auto. rewrite B. unfold is_late, LateAt.
    set (g := greatest_of None (firstn i log)) in *.
    destruct (lateness t) as [d |]; [| split; [discriminate | intros (d & Q & _); discriminate]].
    destruct g as [a |] eqn:G; unfold g in G.
    + destruct (time_of e) as [z |] eqn:T.
      * apply greatest_before in G as (G1 & _ & G3). rewrite Z.ltb_lt. split.
        -- intros L. exists d; split; auto. destruct G1 as [G1 | (j & w & G1)]; [discriminate |].
           exists (content e), z, j, w, a. rewrite A.
           assert (J : j < i).
           { assert (j < length (firstn i log)) by (apply nth_error_Some; congruence).
             rewrite firstn_length in H; lia. }
           repeat split; auto. now rewrite nth_firstn in G1.
        -- intros (d' & Q & v & z' & j & w & y & X & J & Y & L). injection Q as <-.
           rewrite A in X. injection X as _ <-. rewrite <- (nth_firstn i) in Y by auto. apply G3 in Y. lia.
      * split; [discriminate |]. intros (d' & _ & v & z' & j & w & y & X & _). rewrite A in X. discriminate.
    + split; [discriminate |]. intros (d' & _ & v & z' & j & w & y & _ & J & Y & _).
      exfalso. rewrite <- (nth_firstn i) in Y by auto. eapply no_greatest; eauto.
Qed.

(** ** Relevant events *)

Definition no_time (p : point) : option Z := None.

(** Whether a value fits a pattern under an assignment under which a guard holds. *)
Definition fits_with (p : pattern) (g : option guard) (v : value) : bool :=
  existsb (fun bs => match g with Some g => holds (get Nat.eqb bs) no_time g | None => true end) (bindings p v).

Lemma fits_with_iff : forall p g v, (forall g', g = Some g' -> incl (variables g') (pattern_variables p)) ->
  (fits_with p g v = true <-> exists a, fits_pattern a p v /\
     match g with Some g => holds a no_time g = true | None => True end).
Proof.
  intros p g v V. unfold fits_with. rewrite existsb_exists. split.
  - intros (bs & I & H). exists (get Nat.eqb bs). split.
    + apply bindings_iff. exists bs; split; auto. now apply (bindings_agree p v).
    + destruct g; auto.
  - intros (a & F & H). apply bindings_iff in F as (bs & I & R). exists bs; split; auto.
    destruct g as [g |]; auto. rewrite <- H. apply holds_same; auto. intros x X.
    apply (respects_get Nat.eqb Nat.eqb_eq); auto. apply (bindings_variables p v bs); auto. apply (V g); auto.
Qed.

Definition own_guard (p : pattern) (g : option guard) : option guard :=
  match g with
  | Some g => if is_nil (points g) && forallb (fun x => member x (pattern_variables p)) (variables g) then Some g
    else None
  | None => None
  end.

(** The patterns of relevant events with their guards. *)
Definition alphabet (t : tree) : list (pattern * option guard) :=
  flat_map (fun n => match on (node_at t n) with
                     | Some p => [(p, own_guard p (when (node_at t n)))]
                     | None => []
                     end) (nodup Nat.eq_dec (reach (whole t) 0)).

Definition is_ignored (t : tree) (e : event) : bool :=
  existsb (fun i => fits_with (fst i) (snd i) (content e)) (ignores t).

Definition relevant_event (t : tree) : event -> bool :=
  let patterns := alphabet t in
  fun e => negb (late e) && negb (is_ignored t e) && existsb (fun i => fits_with (fst i) (snd i) (content e)) patterns.

Lemma whole_in : forall t n kept, In (n, kept) (whole t) <-> n < length (nodes t) /\ kept = children (node_at t n).
Proof.
  intros t n kept; unfold whole, node_at.
  assert (L : length (nodes t) = length (map children (nodes t))) by now rewrite map_length.
  rewrite L, (combine_seq _ _ (children nowhere)), Nat.sub_0_r, map_nth. split; intros [A B]; (split; [lia | auto]).
Qed.

Lemma whole_reach : forall t n, WellFormed t -> (In n (reach (whole t) 0) <-> Reached (whole t) 0 n).
Proof.
  intros t n W. unfold reach. rewrite (fold_reach _ 0).
  - split; [intros (a & [<- | []] & R); auto | intros R; exists 0; simpl; auto].
  - unfold whole. generalize (map children (nodes t)) as l. generalize 0 as i. generalize (length (nodes t)) as k.
    induction k as [| k IH]; intros i l; simpl; auto. destruct l; simpl; auto.
  - intros m kept c I J. apply whole_in in I as [L ->]. now destruct (children_below t W m c L J).
Qed.

Lemma own_guard_variables : forall p g g', own_guard p g = Some g' -> incl (variables g') (pattern_variables p).
Proof.
  intros p [g |] g' H; simpl in H; [| discriminate]. destruct (_ && _) eqn:C in H; [| discriminate].
  injection H as ->. apply andb_true_iff in C as [_ C]. rewrite forallb_forall in C.
  intros x X. now apply member_iff, C.
Qed.

Lemma own_guard_iff : forall p g a,
  match own_guard p g with Some g' => holds a no_time g' = true | None => True end <->
  match g with
  | Some g => points g = [] -> incl (variables g) (pattern_variables p) -> holds a no_time g = true
  | None => True
  end.
Proof.
  intros p [g |] a; simpl; [| tauto]. destruct (_ && _) eqn:C.
  - split; auto. intros H. apply andb_true_iff in C as [P V]. apply H; [now apply is_nil_iff |].
    rewrite forallb_forall in V. intros x X. now apply member_iff, V.
  - split; auto. intros _ P V. exfalso. rewrite P in C. simpl in C. rewrite <- not_true_iff_false in C. apply C.
    apply forallb_forall. intros x X. now apply member_iff, V.
Qed.

Theorem relevant_event_iff : forall t e, WellFormed t -> (relevant_event t e = true <-> RelevantEvent t e).
Proof.
  intros t e W. unfold relevant_event, RelevantEvent. rewrite !andb_true_iff, !negb_true_iff.
  assert (IG : is_ignored t e = true <-> Ignored t e).
  { unfold is_ignored, Ignored. rewrite existsb_exists. split.
    - intros ([p g] & I & H). apply fits_with_iff in H as (a & F & H).
      + exists p, g, a; auto.
      + intros g' Q; simpl in *; subst. eapply own_variables; eauto.
    - intros (p & g & a & I & F & H). exists (p, g); split; auto. apply fits_with_iff; [| exists a; auto].
      intros g' Q; simpl in *; subst. eapply own_variables; eauto. }
  assert (AL : existsb (fun i => fits_with (fst i) (snd i) (content e)) (alphabet t) = true <->
    exists n p a, Reached (whole t) 0 n /\ on (node_at t n) = Some p /\ fits_pattern a p (content e) /\
    match when (node_at t n) with
    | Some g => points g = [] -> incl (variables g) (pattern_variables p) -> holds a (fun _ => None) g = true
    | None => True
    end).
  { rewrite existsb_exists. split.
    - intros ([p g] & I & H). apply in_flat_map in I as (n & I & J). apply nodup_In, (whole_reach t n W) in I.
      destruct (on (node_at t n)) as [q |] eqn:O; [| destruct J]. destruct J as [J | []]. injection J; intros; subst.
      simpl in H. apply fits_with_iff in H as (a & F & H); [| apply own_guard_variables].
      exists n, p, a. rewrite (own_guard_iff p (when (node_at t n)) a) in H. auto.
    - intros (n & p & a & R & O & F & H). exists (p, own_guard p (when (node_at t n))). split.
      + apply in_flat_map. exists n; split; [now apply nodup_In, whole_reach |]. rewrite O; simpl; auto.
      + simpl. apply fits_with_iff; [apply own_guard_variables |]. exists a; split; auto.
        now apply (own_guard_iff p (when (node_at t n)) a). }
  rewrite AL. rewrite <- IG, <- not_true_iff_false, not_true_iff_false. split.
  - intros [[A B] C]. split; [auto |]. split; [congruence | auto].
  - intros (A & B & C). split; [split; [auto |] | auto]. now apply not_true_is_false.
Qed.

(** ** The monitor *)

Definition all_tracked (t : tree) (w : selection) : list (tracked event key) :=
  selected_scenarios (tracked_here t) t w.

Lemma tracked_plans : forall t w, map plan_of (all_tracked t w) = plans t w.
Proof. intros t w. unfold all_tracked. now rewrite map_scenarios. Qed.

Lemma all_sound : forall t w, WellFormed t -> Forall (Sound covered) (all_tracked t w).
Proof.
  intros t w W. apply Forall_forall. intros q I. apply in_scenarios in I as (r & chosen & I & _ & _ & _ & _ & ->).
  apply resolutions_iff in I; auto. apply (tracked_sound t _ _ _ _ r). now apply parts_iff.
Qed.

(** A tree without absent events is watched by the search that drops partial matches which others cover. *)
Inductive state := Pruned (x : pruned_monitor event key) | Watched (x : watch event).

(** The monitor of a tree: its first state after events of the past, and the state after an event. *)
Definition first_after (t : tree) (w : selection) : list event -> state :=
  if no_absences t
  then let x := Pruned (pruned_init (all_tracked t w)) in fun _ => x
  else let qs := all_watched t w in fun past => Watched (watch_init past qs).
Definition first (t : tree) (w : selection) : state := first_after t w [].
Definition next (t : tree) (s : semantics) : state -> event -> state :=
  let relevant := relevant_event t in
  fun x e => match x with
             | Pruned x => Pruned (pruned_advance relevant covered s x e)
             | Watched x => Watched (watch_advance relevant s x e)
             end.
Definition verdict_after (x : state) : verdict :=
  match x with Pruned x => pruned_verdict x | Watched x => watch_verdict x end.

(** The state after the end of the trace. *)
Definition finish (x : state) : state := match x with Pruned x => Pruned x | Watched x => Watched (watch_finish x) end.

(** With repetition: after a detection it starts afresh with the next event. *)
Definition next_repeated (begin : list event -> state) (step : state -> event -> state) (x : state) (e : event) :=
  match x with
  | Pruned Finished => step (begin []) e
  | Watched (Ended h) => step (begin h) e
  | _ => step x e
  end.

(** *** The verdict depends only on the scenarios up to [Alike] *)

Lemma alike_partial : forall E (c d : scenario E), Alike c d -> forall u pos m, Partial c u pos m -> Partial d u pos m.
Proof.
  intros E c d [O B C _] u pos m []; constructor; auto.
  - intros o I. now apply O, of_scenario.
  - intros o p I J H. apply downward_closed with o; auto; [now apply O |]. apply B; auto. now apply O.
  - intros o p I J H. apply precedence_kept; auto. apply B; auto.
  - now apply C.
Qed.

Lemma alike_sym : forall E (c d : scenario E), Alike c d -> Alike d c.
Proof.
  intros E c d [O B C U]; constructor.
  - intros o; symmetry; auto.
  - intros p o I J. symmetry. apply B; now apply O.
  - intros m N I; symmetry. apply C; auto. intros o J. now apply O, I.
  - intros u pos m N I K. assert (J : incl (domain m) (occurrences c)) by (intros o J; now apply O, I).
    destruct (U u pos m N J) as [A D]; [now apply C | split; symmetry; auto].
Qed.

Lemma alike_complete : forall E (c d : scenario E) m, Alike c d -> complete c m -> complete d m.
Proof. intros E c d m [O _ _ _] H o I. apply H. now apply O. Qed.

Lemma alike_watched : forall E (c d : scenario E), Alike c d -> forall u pos m, Partial c u pos m ->
  (unbroken c u pos m <-> unbroken d u pos m) /\ (decided c u pos m <-> decided d u pos m).
Proof.
  intros E c d A u pos m P. apply (alike_unbroken _ _ A); [apply (once _ _ _ _ P) | apply (of_scenario _ _ _ _ P) |
    apply (conditions_hold _ _ _ _ P)].
Qed.

Lemma relevant_positions_same : forall E (Rel Rel' : E -> Prop) s u used, (forall e, Rel e <-> Rel' e) ->
  (match_positions Rel s u used <-> match_positions Rel' s u used) /\
  (partial_positions Rel s u used <-> partial_positions Rel' s u used).
Proof.
  intros E Rel Rel' s u used R. apply positions_same; auto; [| reflexivity]. intros i.
  split; intros (e & N & H); exists e; split; auto; now apply R.
Qed.

Lemma detected_same : forall E (Rel Rel' : E -> Prop) (S S' : scenario E -> Prop), (forall e, Rel e <-> Rel' e) ->
  (forall c, S c -> exists d, S' d /\ Alike c d) ->
  forall s u, Detected Rel S s u -> Detected Rel' S' s u.
Proof.
  intros E Rel Rel' S S' R F s u (w & v & c & Q & I & pos & m & P & C & M & U). destruct (F c I) as (d & J & A).
  exists w, v, d. split; [auto | split; [auto |]]. exists pos, m. split; [eapply alike_partial; eauto |].
  split; [eapply alike_complete; eauto |]. split; [now apply (relevant_positions_same E Rel Rel' s w _ R) |].
  destruct (alike_watched E c d A w pos m P). tauto.
Qed.

Lemma left_same : forall E (Rel Rel' : E -> Prop) (S S' : scenario E -> Prop), (forall e, Rel e <-> Rel' e) ->
  (forall c, S c -> exists d, S' d /\ Alike c d) ->
  forall s u, Left Rel S s u -> Left Rel' S' s u.
Proof.
  intros E Rel Rel' S S' R F s u (c & I & pos & m & P & U & H). destruct (F c I) as (d & J & A).
  destruct (alike_watched E c d A u pos m P) as [UB DE].
  exists d; split; auto. exists pos, m. split; [eapply alike_partial; eauto |]. split; [now apply UB |].
  destruct H as [[C M] | (C & M & D)]; [left | right].
  - split; [intros X; apply C; eapply alike_complete; eauto using alike_sym |].
    now apply (relevant_positions_same E Rel Rel' s u _ R).
  - split; [eapply alike_complete; eauto |]. split; [now apply (relevant_positions_same E Rel Rel' s u _ R) |].
    now rewrite <- DE.
Qed.

Lemma verdict_same : forall E (Rel Rel' : E -> Prop) (S S' : scenario E -> Prop), (forall e, Rel e <-> Rel' e) ->
  (forall c, S c -> exists d, S' d /\ Alike c d) -> (forall d, S' d -> exists c, S c /\ Alike d c) ->
  forall s u v, Verdict Rel S s u v -> Verdict Rel' S' s u v.
Proof.
  intros E Rel Rel' S S' R F B s u v H.
  assert (D : Detected Rel S s u <-> Detected Rel' S' s u).
  { split; apply detected_same; auto; intros; symmetry; auto. }
  assert (L : Left Rel S s u <-> Left Rel' S' s u).
  { split; apply left_same; auto; intros; symmetry; auto. }
  destruct v; simpl in *; rewrite <- ?D, <- ?L; auto.
Qed.

(** The monitor after events of the past: its states, and the verdict of the definition. *)
Lemma run_pruned : forall t w s past trace, no_absences t = true ->
  fold_left (next t s) trace (first_after t w past) =
  Pruned (pruned_run (relevant_event t) covered s (all_tracked t w) trace).
Proof.
  intros t w s past trace N. unfold first_after, pruned_run. rewrite N. generalize (pruned_init (all_tracked t w)).
  induction trace as [| e trace IH]; simpl; intros x; auto.
Qed.

Lemma run_watched : forall t w s past trace, no_absences t = false ->
  fold_left (next t s) trace (first_after t w past) =
  Watched (watch_run (relevant_event t) s past (all_watched t w) trace).
Proof.
  intros t w s past trace N. unfold first_after, watch_run. rewrite N. generalize (watch_init past (all_watched t w)).
  induction trace as [| e trace IH]; simpl; intros x; auto.
Qed.

Lemma after_correct : forall t w s past trace, well_formed t = true ->
  Verdict (RelevantEvent t) (IsScenario t w past) s trace
    (verdict_after (fold_left (next t s) trace (first_after t w past))).
Proof.
  intros t w s past trace W. apply well_formed_iff in W. destruct (no_absences t) eqn:N.
  - rewrite run_pruned by auto. apply (verdict_same _ (fun e => relevant_event t e = true) _ (Scenarios (plans t w))).
    + intros e. now apply relevant_event_iff.
    + intros c (d & I & ->). exists (denoted d). split; [now apply plans_sound |].
      constructor; intros; reflexivity || (split; reflexivity).
    + intros c I. destruct (plans_complete t w past c W N I) as (d & J & A). exists (denoted d); split; auto.
      exists d; auto.
    + rewrite <- tracked_plans. apply (pruned_is_verdict (relevant_event t) covered). now apply all_sound.
  - rewrite run_watched by auto.
    apply (verdict_same _ (fun e => relevant_event t e = true) _ (ScenariosAfter past (all_watched t w))).
    + intros e. now apply relevant_event_iff.
    + intros c (q & I & ->). exists (denoted_after past q). split; [now apply watched_sound |].
      constructor; intros; reflexivity || (split; reflexivity).
    + intros c I. destruct (watched_complete t w past c W I) as (q & J & A).
      exists (denoted_after past q); split; auto.
      exists q; auto.
    + apply watch_correct. now apply all_watchable.
Qed.

Lemma at_end_same : forall E (Rel Rel' : E -> Prop) (S S' : scenario E -> Prop), (forall e, Rel e <-> Rel' e) ->
  (forall c, S c -> exists d, S' d /\ Alike c d) ->
  forall s u, DetectedAtEnd Rel S s u -> DetectedAtEnd Rel' S' s u.
Proof.
  intros E Rel Rel' S S' R F s u [D | (c & I & pos & m & P & C & M & U & _)]; [left; eapply detected_same; eauto |].
  right. destruct (F c I) as (d & J & A). exists d. split; auto. exists pos, m.
  assert (P' : Partial c u pos m) by (destruct P; constructor; auto).
  assert (Q := alike_partial E c d A u pos m P').
  split; [destruct Q; constructor; auto |]. split; [exact (alike_complete E c d m A C) |].
  split; [now apply (relevant_positions_same E Rel Rel' s u _ R) | split; [| exact Logic.I]].
  now apply (alike_watched E c d A u pos m P').
Qed.

Lemma finish_after : forall t w s past trace, well_formed t = true ->
  VerdictAtEnd (RelevantEvent t) (IsScenario t w past) s trace
    (verdict_after (finish (fold_left (next t s) trace (first_after t w past)))).
Proof.
  intros t w s past trace W. assert (V := after_correct t w s past trace W). destruct (no_absences t) eqn:N.
  - rewrite run_pruned in * by auto. cbn [finish].
    assert (D : DetectedAtEnd (RelevantEvent t) (IsScenario t w past) s trace <->
      Detected (RelevantEvent t) (IsScenario t w past) s trace).
    { split; [| left; auto]. intros [D | (c & I & pos & m & P & C & M & U & _)]; auto.
      exists trace, [], c. rewrite app_nil_r. split; [auto | split; [auto |]]. exists pos, m.
      assert (P' : Partial c trace pos m) by (destruct P; constructor; auto).
      split; [auto | split; [auto | split; [auto | split; [auto |]]]].
      apply (scenario_quiet t w past c N I); [apply (once _ _ _ _ P') | apply (of_scenario _ _ _ _ P') |
        apply (conditions_hold _ _ _ _ P')]. }
    destruct (verdict_after (Pruned _)); simpl in *; tauto.
  - rewrite run_watched in * by auto. cbn [finish verdict_after] in *. apply well_formed_iff in W.
    assert (X := finish_correct (relevant_event t) s past (all_watched t w) trace (all_watchable t w W)).
    assert (R : forall e, relevant_event t e = true <-> RelevantEvent t e) by (intros; now apply relevant_event_iff).
    assert (F : forall c, ScenariosAfter past (all_watched t w) c -> exists d, IsScenario t w past d /\ Alike c d).
    { intros c (q & I & ->). exists (denoted_after past q). split; [now apply watched_sound |].
      constructor; intros; reflexivity || (split; reflexivity). }
    assert (B : forall c, IsScenario t w past c -> exists d, ScenariosAfter past (all_watched t w) d /\ Alike c d).
    { intros c I. destruct (watched_complete t w past c W I) as (q & J & A). exists (denoted_after past q); split; auto.
      exists q; auto. }
    assert (D : DetectedAtEnd (RelevantEvent t) (IsScenario t w past) s trace <->
      DetectedAtEnd (fun e => relevant_event t e = true) (ScenariosAfter past (all_watched t w)) s trace).
    { split; apply at_end_same; auto. intros; symmetry; auto. }
    assert (L : Left (RelevantEvent t) (IsScenario t w past) s trace <->
      Left (fun e => relevant_event t e = true) (ScenariosAfter past (all_watched t w)) s trace).
    { split; apply left_same; auto. intros; symmetry; auto. }
    destruct (watch_verdict (watch_finish _)); simpl in *; tauto.
Qed.

(** For a well-formed tree, every selection, every semantics and every trace, the monitor gives the
    verdict of the definition. *)
Theorem monitor_correct : forall t w s trace, well_formed t = true ->
  VerdictOfTree t w s trace (verdict_after (fold_left (next t s) trace (first t w))).
Proof. intros t w s trace W. now apply after_correct. Qed.

(** There is exactly one verdict. *)
Theorem verdict_unique : forall E (Rel : E -> Prop) (S : scenario E -> Prop) s u v v', Verdict Rel S s u v ->
  Verdict Rel S s u v' -> v = v'.
Proof. intros E Rel S s u v v'; destruct v, v'; simpl; tauto. Qed.

(** The monitor has detected. *)
Definition has_ended (x : state) : bool :=
  match x with Pruned Finished | Watched (Ended _) => true | _ => false end.

Lemma ended_detected : forall t w s past u, well_formed t = true ->
  (has_ended (fold_left (next t s) u (first_after t w past)) = true <->
   Detected (RelevantEvent t) (IsScenario t w past) s u).
Proof.
  intros t w s past u W. assert (V := after_correct t w s past u W). unfold verdict_after in V.
  destruct (fold_left (next t s) u (first_after t w past)) as [[| l] | [h | h l]]; simpl in *; try tauto;
    (split; [discriminate |]); intros D; match type of V with context [if ?b then _ else _] => destruct b end;
    simpl in V; tauto.
Qed.

(** A monitor that has detected knows all events so far. *)
Lemma ended_past : forall t w s past u h, no_absences t = false -> well_formed t = true ->
  fold_left (next t s) u (first_after t w past) = Watched (Ended h) -> h = past ++ u.
Proof.
  intros t w s past u h N W H. rewrite run_watched in H by auto. injection H as H.
  destruct (run_watch (relevant_event t) s past (all_watched t w)) with (u := u) as [[Q _] | (l & Q & _)];
    [apply all_watchable; now apply well_formed_iff | congruence | congruence].
Qed.

(** With repetition the monitor is the one that starts after the last detection. *)
Lemma repeated_since : forall t w s trace, well_formed t = true ->
  let step := next t s in
  exists past recent, trace = past ++ recent /\ Since (RelevantEvent t) (IsScenario t w) s past recent /\
    fold_left (next_repeated (first_after t w) step) trace (first t w) = fold_left step recent (first_after t w past).
Proof.
  intros t w s trace W. cbv zeta. set (step := next t s).
  induction trace as [| e trace IH] using rev_ind; [exists [], []; repeat split; constructor |].
  destruct IH as (past & recent & -> & I & Q). rewrite fold_left_app. simpl. rewrite Q.
  assert (E := ended_detected t w s past recent W). fold step in E.
  destruct (has_ended (fold_left step recent (first_after t w past))) eqn:X.
  - exists (past ++ recent), [e]. split; [auto | split; [apply since_detection; auto; now apply E |]]. simpl.
    destruct (fold_left step recent (first_after t w past)) as [[| l] | [h | h l]] eqn:F; try discriminate; simpl.
    + f_equal. destruct (no_absences t) eqn:N; [unfold first_after; now rewrite N |].
      unfold step in F. rewrite run_watched in F by auto. discriminate.
    + destruct (no_absences t) eqn:N; [unfold step in F; rewrite run_pruned in F by auto; discriminate |].
      apply ended_past in F as ->; auto.
  - exists past, (recent ++ [e]). split; [now rewrite app_assoc | split].
    + apply since_before; auto. rewrite <- E. discriminate.
    + rewrite fold_left_app. simpl.
      destruct (fold_left step recent (first_after t w past)) as [[| l] | [h | h l]]; try discriminate; auto.
Qed.

Theorem repeated_correct : forall t w s trace, well_formed t = true ->
  RepeatedVerdictOfTree t w s trace
    (verdict_after (fold_left (next_repeated (first_after t w) (next t s)) trace (first t w))).
Proof.
  intros t w s trace W. destruct (repeated_since t w s trace W) as (past & recent & -> & I & ->).
  exists past, recent. split; [auto | split; [auto |]]. now apply after_correct.
Qed.

(** At the end of the trace, without and with repetition. *)
Theorem finished_correct : forall t w s trace, well_formed t = true ->
  VerdictAtEnd (RelevantEvent t) (IsScenario t w []) s trace
    (verdict_after (finish (fold_left (next t s) trace (first t w)))).
Proof. intros t w s trace W. now apply finish_after. Qed.

Theorem repeated_finished_correct : forall t w s trace, well_formed t = true ->
  RepeatedVerdictAtEnd (RelevantEvent t) (IsScenario t w) s trace
    (verdict_after (finish (fold_left (next_repeated (first_after t w) (next t s)) trace (first t w)))).
Proof.
  intros t w s trace W. destruct (repeated_since t w s trace W) as (past & recent & -> & I & ->).
  exists past, recent. split; [auto | split; [auto |]]. now apply finish_after.
Qed.
