(** * RML: the deterministic rules, what they miss, and what is right

    The published monitor reads a text deterministically: a choice and a shuffle commit to their left
    operand whenever it can take the event.  Here are these rules for texts without variables; a proof
    that the disjunction of branches with a common beginning misses detections; and the determinised
    form, which does not. *)

Require Import List Bool Arith Lia.
Require Import RVAFT.Language RVAFT.Definition RVAFT.Search RVAFT.Plain RVAFT.Automaton RVAFT.Exploration.
Import ListNotations.

(** ** Texts *)

(** OfType types: [any], [none], a predicate on events, and types derived from others. *)
Inductive event_type :=
| AnyEvent
| NoEvent
| Predicate (p : nat)
| NotType (t : event_type)
| EitherType (t t' : event_type)
| BothTypes (t t' : event_type).

Inductive term :=
| All
| Empty
| Nothing
| OfType (t : event_type)
| Concat (x y : term)
| Union (x y : term)                            (* \/ *)
| Intersection (x y : term)                              (* /\ *)
| Shuffle (x y : term)                           (* | *)
| Filter (t : event_type) (x y : term)           (* t >> x : y, where y is [all] unless written *)
| Star (x : term)
| Optional (x : term)
| Call (n : nat).                                (* the equation number n *)

Fixpoint fits (t : event_type) (a : nat -> bool) : bool :=
  match t with
  | AnyEvent => true
  | NoEvent => false
  | Predicate p => a p
  | NotType t => negb (fits t a)
  | EitherType t t' => fits t a || fits t' a
  | BothTypes t t' => fits t a && fits t' a
  end.

(** Normal forms of the monitor. *)
Definition then_ (x y : term) : term :=
  match x, y with
  | All, _ => All
  | Nothing, _ => Nothing
  | _, Empty => x
  | Empty, _ => y
  | _, _ => Concat x y
  end.
Definition shuffled (x y : term) : term := match x, y with Empty, _ => y | _, Empty => x | _, _ => Shuffle x y end.
Definition joined (x y : term) : term := match x, y with All, _ => y | _, All => x | _, _ => Intersection x y end.
Definition filtered (t : event_type) (x y : term) : term := match x, y with All, All => All | _, _ => Filter t x y end.

(** ** The rules *)

Section Rules.
Variable equations : list term.
Definition body (n : nat) : term := nth n equations Nothing.

(** The operands of the terms that halt when both do. *)
Definition operands (t : term) : option (term * term) :=
  match t with Concat x y | Intersection x y | Shuffle x y | Filter _ x y => Some (x, y) | _ => None end.

(** Whether a trace may end at a term; the second operand counts when the first does not decide. *)
Inductive Halts : term -> bool -> Prop :=
| halts_all : Halts All true
| halts_empty : Halts Empty true
| halts_star : forall x, Halts (Star x) true
| halts_optional : forall x, Halts (Optional x) true
| halts_nothing : Halts Nothing false
| halts_event : forall t, Halts (OfType t) false
| halts_first : forall t x y, operands t = Some (x, y) -> Halts x false -> Halts t false
| halts_second : forall t x y b, operands t = Some (x, y) -> Halts x true -> Halts y b -> Halts t b
| halts_left : forall x y, Halts x true -> Halts (Union x y) true
| halts_right : forall x y b, Halts x false -> Halts y b -> Halts (Union x y) b
| halts_call : forall n b, Halts (body n) b -> Halts (Call n) b.

(** The term after an event, or [None] where no rule applies. *)
Inductive Step (a : nat -> bool) : term -> option term -> Prop :=
| step_all : Step a All (Some All)
| step_empty : Step a Empty None
| step_nothing : Step a Nothing None
| step_event : forall t, Step a (OfType t) (if fits t a then Some Empty else None)
| step_left : forall x y x', Step a x (Some x') -> Step a (Union x y) (Some x')
| step_right : forall x y r, Step a x None -> Step a y r -> Step a (Union x y) r
| step_both : forall x y r q, Step a x r -> Step a y q ->
    Step a (Intersection x y) (match r, q with Some x', Some y' => Some (joined x' y') | _, _ => None end)
| step_shuffle_left : forall x y x', Step a x (Some x') -> Step a (Shuffle x y) (Some (shuffled x' y))
| step_shuffle_right : forall x y r, Step a x None -> Step a y r -> Step a (Shuffle x y) (option_map (shuffled x) r)
| step_first : forall x y x', Step a x (Some x') -> Step a (Concat x y) (Some (then_ x' y))
| step_second : forall x y r, Step a x None -> Halts x true -> Step a y r -> Step a (Concat x y) r
| step_neither : forall x y, Step a x None -> Halts x false -> Step a (Concat x y) None
| step_inside : forall t x y r, fits t a = true -> Step a x r ->
    Step a (Filter t x y) (option_map (fun x' => filtered t x' y) r)
| step_outside : forall t x y r, fits t a = false -> Step a y r -> Step a (Filter t x y) (option_map (filtered t x) r)
| step_star : forall x r, Step a x r -> Step a (Star x) (option_map (fun x' => then_ x' (Star x)) r)
| step_optional : forall x r, Step a x r -> Step a (Optional x) r
| step_call : forall n r, Step a (body n) r -> Step a (Call n) r.

(** The verdict of a text (section 5 of the definition): true from the first prefix whose state may
    halt, false when no rule applies any more. *)
Inductive RmlVerdict : term -> list (nat -> bool) -> verdict -> Prop :=
| verdict_halts : forall t w, Halts t true -> RmlVerdict t w Top
| verdict_open : forall t, Halts t false -> RmlVerdict t [] Unknown
| verdict_stops : forall t a w, Halts t false -> Step a t None -> RmlVerdict t (a :: w) Bottom
| verdict_goes_on : forall t a w t' v, Halts t false -> Step a t (Some t') -> RmlVerdict t' w v ->
    RmlVerdict t (a :: w) v.

(** The rules are deterministic. *)
Lemma halts_unique : forall t b, Halts t b -> forall c, Halts t c -> b = c.
Proof.
  induction 1; intros d K; inversion K; subst; try discriminate; auto;
    repeat match goal with
    | P : operands ?t = Some _, Q : operands ?t = Some _ |- _ => rewrite P in Q; injection Q as <- <-
    | IH : forall c, Halts ?x c -> ?b = c, H : Halts ?x _ |- _ => apply IH in H; try discriminate H; subst
    end; auto.
Qed.

Lemma step_unique : forall a t r, Step a t r -> forall q, Step a t q -> r = q.
Proof.
  induction 1; intros s K; inversion K; subst; auto;
    repeat match goal with
    | IH : forall q, Step ?a ?x q -> ?r = q, H : Step ?a ?x ?q' |- _ => apply IH in H; try discriminate H; subst
    end; auto; try congruence.
  all: match goal with H : Halts ?x true, H' : Halts ?x false |- _ => pose proof (halts_unique _ _ H _ H');
    discriminate end.
Qed.

Theorem verdict_unique : forall t w v, RmlVerdict t w v -> forall v', RmlVerdict t w v' -> v = v'.
Proof.
  induction 1 as [t w H | t H | t a w H S | t a w t' v H S K IH]; intros v' K'; inversion K'; subst; auto;
    try match goal with H : Halts ?x true, H' : Halts ?x false |- _ => pose proof (halts_unique _ _ H _ H');
      discriminate end.
  - match goal with H : Step _ _ (Some _) |- _ => pose proof (step_unique _ _ _ S _ H); discriminate end.
  - match goal with H : Step _ _ None |- _ => pose proof (step_unique _ _ _ S _ H); discriminate end.
  - match goal with H : Step _ _ (Some ?x) |- _ => pose proof (step_unique _ _ _ S _ H) as Q; injection Q as <- end.
    auto.
Qed.

Lemma all_verdict : forall w v, RmlVerdict All w v -> v = Top.
Proof. intros w v K. apply (verdict_unique _ _ _ K), verdict_halts, halts_all. Qed.

(** ** A filter leaves out the other events *)

Lemma filter_halts : forall t x b, Halts x b -> Halts (Filter t x All) b.
Proof.
  intros t x [] H; [exact (halts_second (Filter t x All) x All true eq_refl H halts_all) |].
  exact (halts_first (Filter t x All) x All eq_refl H).
Qed.

Lemma filter_verdict : forall t x w v, RmlVerdict x (filter (fits t) w) v -> RmlVerdict (Filter t x All) w v.
Proof.
  intros t x w; revert x; induction w as [| a w IH]; intros x v K; simpl in K; pose proof (filter_halts t x) as O.
  - inversion K; subst.
    + apply verdict_halts; auto.
    + apply verdict_open; auto.
  - destruct (fits t a) eqn:F.
    + inversion K as [? ? H | | ? ? ? H S | ? ? ? x' ? H S K']; subst.
      * apply verdict_halts; auto.
      * apply verdict_stops; auto. exact (step_inside a t x All None F S).
      * apply verdict_goes_on with (filtered t x' All); auto; [exact (step_inside a t x All (Some x') F S) |].
        destruct x'; try (apply IH; exact K'). simpl.
        now rewrite (all_verdict _ _ K'); apply verdict_halts; constructor.
    + specialize (IH x v K). destruct (match x with All => true | _ => false end) eqn:A.
      * destruct x; try discriminate. rewrite (all_verdict _ _ K). apply verdict_halts. apply O. constructor.
      * assert (S : Step a (Filter t x All) (Some (Filter t x All))).
        { pose proof (step_outside a t x All (Some All) F (step_all a)) as S. simpl in S.
          destruct x; try exact S. discriminate. }
        assert (D : (exists b, Halts x b)) by (inversion K; eauto). destruct D as [[] D].
        -- replace v with Top; [apply verdict_halts; auto |].
           eapply verdict_unique; [apply verdict_halts; apply O, D | exact IH].
        -- apply verdict_goes_on with (Filter t x All); auto.
Qed.
End Rules.

(** ** Left preference misses detections *)

(** A sequence of events, each of which satisfies a predicate. *)
Fixpoint events (ps : list nat) : term :=
  match ps with
  | [] => Empty
  | [p] => OfType (Predicate p)
  | p :: ps => Concat (OfType (Predicate p)) (events ps)
  end.

(** Two branches that have the beginning [ps] in common: [((ps q) \/ (ps r)) all]. *)
Definition branches (ps : list nat) (q r : nat) : term := Concat (Union (events (ps ++ [q])) (events (ps ++ [r]))) All.

Definition in_order (ps : list nat) : shape :=
  Shape (map (fun i => (i, 0)) (seq 0 (length ps))) (fun o p => Nat.ltb (fst o) (fst p)) (fun o => nth (fst o) ps 0).

Section LeftPreference.
Context {E : Type}.
Variable satisfies : nat -> E -> bool.
Notation relevant := (relevant satisfies).

Lemma events_cons : forall p ps q, events (p :: ps ++ [q]) = Concat (OfType (Predicate p)) (events (ps ++ [q])).
Proof. intros p [| p' ps] q; reflexivity. Qed.

Lemma halts_events : forall eqs ps q, Halts eqs (events (ps ++ [q])) false.
Proof.
  intros eqs; induction ps as [| p ps IH]; intros q; [constructor |]. cbn [app]. rewrite events_cons.
  eapply halts_first; [reflexivity | constructor].
Qed.

Lemma events_not_simple : forall ps q y, y <> Empty -> then_ (events (ps ++ [q])) y = Concat (events (ps ++ [q])) y.
Proof. intros [| p ps] q y N; [| cbn [app]; rewrite events_cons]; destruct y; simpl; congruence. Qed.

Lemma step_events : forall eqs a p ps q, a p = true ->
  Step eqs a (events ((p :: ps) ++ [q])) (Some (events (ps ++ [q]))).
Proof.
  intros eqs a p ps q F. cbn [app]. rewrite events_cons.
  replace (events (ps ++ [q])) with (then_ Empty (events (ps ++ [q]))) at 2.
  - constructor. pose proof (step_event eqs a (Predicate p)) as S. simpl in S. now rewrite F in S.
  - destruct ps; [reflexivity |]. cbn [app]. now rewrite events_cons.
Qed.

(** Once committed to the left branch, the text stops at an event that only the right one takes. *)
Lemma committed_stops : forall eqs ps q u e', Forall2 (fun p e => satisfies p e = true) ps u ->
  satisfies q e' = false ->
  RmlVerdict eqs (Concat (events (ps ++ [q])) All) (valuations satisfies (u ++ [e'])) Bottom.
Proof.
  intros eqs ps q u e' F N. induction F as [| p e ps u P F IH].
  - apply verdict_stops.
    + eapply halts_first; [reflexivity | constructor].
    + pose proof (step_event eqs (fun p => satisfies p e') (Predicate q)) as S. simpl in S. rewrite N in S.
      apply step_neither; auto. constructor.
  - apply verdict_goes_on with (then_ (events (ps ++ [q])) All).
    + eapply halts_first; [reflexivity | apply (halts_events eqs (p :: ps))].
    + constructor. now apply step_events.
    + rewrite events_not_simple by discriminate. exact IH.
Qed.

(** The compositional form is not faithful.  Whenever two branches begin alike, a trace of the right
    branch whose last event the left one does not take is detected, and the text says false: so
    [(a b) \/ (a c)] rejects [a c].  The disjunction of the branches 1 and 3 of the remote inspection
    tree misses the attack for this reason, but it has variables, and is no instance of the theorem. *)
Theorem branches_miss : forall eqs ps q r u e', ps <> [] -> Forall2 (fun p e => satisfies p e = true) ps u ->
  satisfies r e' = true -> satisfies q e' = false ->
  RmlVerdict eqs (branches ps q r) (valuations satisfies (u ++ [e'])) Bottom /\
  Verdict (fun e => relevant e = true)
    (Scenarios (map (plain satisfies) [in_order (ps ++ [q]); in_order (ps ++ [r])])) Strict (u ++ [e']) Top.
Proof.
  intros eqs ps q r u e' NE F R Q. split.
  - destruct F as [| p e ps u P F]; [congruence |]. unfold branches.
    apply verdict_goes_on with (then_ (events (ps ++ [q])) All).
    + eapply halts_first; [reflexivity |]. apply halts_right; apply (halts_events eqs (p :: ps)).
    + constructor. apply step_left. now apply step_events.
    + rewrite events_not_simple by discriminate. now apply committed_stops.
  - apply (detected_completes satisfies). exists (in_order (ps ++ [r])), [], (u ++ [e']).
    split; [simpl; auto | split; [reflexivity | split; [auto |]]].
    assert (F' : Forall2 (fun p e => satisfies p e = true) (ps ++ [r]) (u ++ [e'])) by (apply Forall2_app; auto).
    clear F R Q NE. revert F'. generalize (u ++ [e']) as w, (ps ++ [r]) as l. clear. intros w l F.
    enough (K : forall m v k done, Forall2 (fun p e => satisfies p e = true) m v -> length l = k + length m ->
        (forall i, i < length m -> nth (k + i) l 0 = nth i m 0) ->
        (forall i, In (i, 0) done <-> i < k) -> Completes satisfies Strict (in_order l) done v).
    { apply (K l w 0); auto. intros i; simpl; split; [tauto | lia]. }
    assert (O : forall p, In p (shape_occurrences (in_order l)) <-> exists i, p = (i, 0) /\ i < length l).
    { intros p. simpl. rewrite in_map_iff. split.
      - intros (i & <- & I). apply in_seq in I. exists i; split; auto; lia.
      - intros (i & -> & I). exists i; split; auto. apply in_seq; lia. }
    induction m as [| p m IH]; intros v k done F' L N D.
    + constructor. apply forallb_forall. intros o I. apply O in I as (i & -> & I). apply among_iff, D. simpl in L; lia.
    + inversion F' as [| ? e ? v' P F0]; subst. simpl in L. apply served with (k, 0); auto.
      * apply O. exists k; split; auto; lia.
      * unfold ready. rewrite andb_true_iff, negb_true_iff, forallb_forall. split.
        -- apply not_true_is_false. rewrite among_iff, D. lia.
        -- intros o I. apply O in I as (i & -> & I). simpl. destruct (Nat.ltb_spec i k); simpl; auto.
           now apply among_iff, D.
      * simpl. specialize (N 0). rewrite Nat.add_0_r in N. rewrite N by (simpl; lia). exact P.
      * apply (IH v' (S k)); auto; [lia | |].
        -- intros i I. replace (S k + i) with (k + S i) by lia. rewrite N by (simpl; lia). reflexivity.
        -- intros i. simpl. rewrite D. split; [intros [Q | H]; [injection Q; lia | lia] |].
           intros H. destruct (Nat.eq_dec k i); [left; congruence | right; lia].
Qed.
End LeftPreference.

(** ** The determinised form *)

(** An alternative of a state: it is taken when all its predicates hold (any event without any), and
    leads to another state, or detects. *)
Record alternative := Alternative { joint : list nat; leads_to : option nat }.

Fixpoint joint_events (ps : list nat) : term :=
  match ps with
  | [] => OfType AnyEvent
  | [p] => OfType (Predicate p)
  | p :: ps => Intersection (OfType (Predicate p)) (joint_events ps)
  end.

Definition written (x : alternative) : term :=
  Concat (joint_events (joint x)) (match leads_to x with Some n => Call n | None => All end).

Fixpoint choices (l : list term) : term := match l with [] => Nothing | [x] => x | x :: l => Union x (choices l) end.

(** A state is an equation: the choice of its alternatives, in their order. *)
Definition determinised (states : list (list alternative)) : list term := map (fun l => choices (map written l)) states.

(** The first alternative that fits decides. *)
Definition first_fit (l : list alternative) (a : nat -> bool) : option alternative :=
  find (fun x => forallb a (joint x)) l.

Fixpoint run_states (states : list (list alternative)) (n : nat) (w : list (nat -> bool)) : verdict :=
  match w with
  | [] => Unknown
  | a :: w =>
    match first_fit (nth n states []) a with
    | None => Bottom
    | Some x => match leads_to x with None => Top | Some m => run_states states m w end
    end
  end.

(** What is left of joint events that have come. *)
Inductive Spent : term -> Prop :=
| spent_one : Spent Empty
| spent_more : forall x, Spent x -> Spent (Intersection Empty x).

Lemma spent_halts : forall eqs x, Spent x -> Halts eqs x true.
Proof.
  intros eqs x S; induction S; [constructor |]. eapply halts_second; [reflexivity | constructor | auto].
Qed.

Lemma spent_step : forall eqs a x, Spent x -> Step eqs a x None.
Proof.
  intros eqs a x S; induction S; [constructor |]. exact (step_both eqs a _ _ _ _ (step_empty eqs a) IHS).
Qed.

Lemma joint_step : forall eqs a ps, if forallb a ps then exists x, Spent x /\ Step eqs a (joint_events ps) (Some x)
                                    else Step eqs a (joint_events ps) None.
Proof.
  intros eqs a ps.
  assert (ONE : forall p, Step eqs a (OfType (Predicate p)) (if a p then Some Empty else None))
    by (intros p; apply (step_event eqs a (Predicate p))).
  destruct ps as [| p ps]; [exists Empty; split; [constructor | apply (step_event eqs a AnyEvent)] |].
  revert p; induction ps as [| p' ps IH]; intros p; simpl forallb.
  - rewrite andb_true_r. specialize (ONE p). destruct (a p); [exists Empty; split; [constructor |] |]; exact ONE.
  - specialize (IH p'). specialize (ONE p). simpl forallb in IH.
    change (joint_events (p :: p' :: ps)) with (Intersection (OfType (Predicate p)) (joint_events (p' :: ps))).
    destruct (a p), (a p' && forallb a ps); simpl andb; cbv iota in *.
    + destruct IH as (x & S & K). exists (Intersection Empty x); split; [now constructor |].
      pose proof (step_both eqs a _ _ _ _ ONE K) as B. simpl in B. destruct S; exact B.
    + exact (step_both eqs a _ _ _ _ ONE IH).
    + destruct IH as (x & S & K). exact (step_both eqs a _ _ _ _ ONE K).
    + exact (step_both eqs a _ _ _ _ ONE IH).
Qed.

Lemma joint_open : forall eqs ps, Halts eqs (joint_events ps) false.
Proof.
  intros eqs [| p [| p' ps]]; try constructor.
  change (joint_events (p :: p' :: ps)) with (Intersection (OfType (Predicate p)) (joint_events (p' :: ps))).
  eapply halts_first; [reflexivity | constructor].
Qed.

Definition next_of (x : alternative) : term := match leads_to x with Some n => Call n | None => All end.

Lemma written_step : forall eqs a x, if forallb a (joint x)
  then exists d, Spent d /\ Step eqs a (written x) (Some (then_ d (next_of x))) else Step eqs a (written x) None.
Proof.
  intros eqs a x. pose proof (joint_step eqs a (joint x)) as J. destruct (forallb a (joint x)).
  - destruct J as (d & S & J). exists d; split; auto. now constructor.
  - apply step_neither; auto. apply joint_open.
Qed.

Lemma choices_step : forall eqs a l, match first_fit l a with
  | Some x => exists d, Spent d /\ Step eqs a (choices (map written l)) (Some (then_ d (next_of x)))
  | None => Step eqs a (choices (map written l)) None end.
Proof.
  intros eqs a; induction l as [| x l IH]; [simpl; constructor |].
  unfold first_fit in *. simpl find. pose proof (written_step eqs a x) as W.
  destruct l as [| y l]; [simpl; destruct (forallb a (joint x)); exact W |].
  change (choices (map written (x :: y :: l))) with (Union (written x) (choices (map written (y :: l)))).
  destruct (forallb a (joint x)).
  - destruct W as (d & S & W). exists d; split; auto. now apply step_left.
  - destruct (find _ (y :: l)) as [z |].
    + destruct IH as (d & S & K). exists d; split; auto. now apply step_right.
    + now apply step_right.
Qed.

Lemma choices_open : forall eqs l, Halts eqs (choices (map written l)) false.
Proof.
  intros eqs; induction l as [| x l IH]; [constructor |].
  assert (W : Halts eqs (written x) false) by (eapply halts_first; [reflexivity | apply joint_open]).
  destruct l; auto. apply halts_right; auto.
Qed.

(** A term that stands for a state: the call of its equation, perhaps behind spent events. *)
Definition Stands (n : nat) (t : term) : Prop := t = Call n \/ exists d, Spent d /\ t = Concat d (Call n).

Lemma spent_then : forall d y, Spent d -> y <> Empty -> then_ d y = y \/ then_ d y = Concat d y.
Proof. intros d y S N; destruct S; destruct y; simpl; auto; congruence. Qed.

(** The determinised text follows its states: in each, the first alternative that fits is taken. *)
Theorem determinised_runs : forall states w n t, Stands n t ->
  RmlVerdict (determinised states) t w (run_states states n w).
Proof.
  intros states. set (eqs := determinised states).
  assert (B : forall n, body eqs n = choices (map written (nth n states []))).
  { intros n. unfold body, eqs, determinised.
    exact (map_nth (fun l => choices (map written l)) states [] n). }
  assert (O : forall n t, Stands n t -> Halts eqs t false).
  { intros n t [-> | (d & S & ->)].
    - constructor. rewrite B. apply choices_open.
    - eapply halts_second; [reflexivity | now apply spent_halts |]. constructor. rewrite B. apply choices_open. }
  assert (ST : forall a n t r, Stands n t -> Step eqs a (choices (map written (nth n states []))) r -> Step eqs a t r).
  { intros a n t r [-> | (d & S & ->)] K.
    - constructor. now rewrite B.
    - apply step_second; [now apply spent_step | now apply spent_halts |]. constructor. now rewrite B. }
  induction w as [| a w IH]; intros n t S; simpl run_states; [apply verdict_open; eauto |].
  pose proof (choices_step eqs a (nth n states [])) as K. destruct (first_fit (nth n states []) a) as [x |].
  - destruct K as (d & D & K). apply verdict_goes_on with (then_ d (next_of x)); eauto.
    unfold next_of. destruct (leads_to x) as [m |].
    + apply IH. destruct (spent_then d (Call m) D) as [-> | ->]; [discriminate | left; auto | right; eauto].
    + apply verdict_halts. destruct (spent_then d All D) as [-> | ->]; [discriminate | constructor |].
      eapply halts_second; [reflexivity | now apply spent_halts | constructor].
  - apply verdict_stops; eauto.
Qed.
