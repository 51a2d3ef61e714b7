(** * Trees in which each event determines the values of variables

    RML follows one assignment of the variables.  This suffices where an event gives one value to a
    variable: all patterns that one event may match have the variable at one place.  The values of all
    unbound variables are then those of the event, and the partial matches of a trace are those of plain
    scenarios that see each event under these values ([followed_states]). *)

Require Import List Bool Arith ZArith Lia.
Require Import RVAFT.Values RVAFT.Language RVAFT.Definition RVAFT.Search RVAFT.Conditions RVAFT.Scenarios.
Require Import RVAFT.Monitor RVAFT.Plain RVAFT.Automaton RVAFT.Exploration RVAFT.Letters.
Require Import RVAFT.PlainTree RVAFT.Slices RVAFT.Clocks RVAFT.SlicedTree RVAFT.SlicedCertificate.
Import ListNotations.

(** ** The place of a variable in a pattern *)

(** The names of the fields that lead to a variable. *)
Fixpoint path (x : nat) (p : pattern) : option (list text) :=
  match p with
  | Named (Rigid y) => if Nat.eqb x y then Some [] else None
  | ObjectWith fields =>
    (fix first fields := match fields with
       | [] => None
       | (f, p) :: fields => match path x p with Some l => Some (f :: l) | None => first fields end
       end) fields
  | Exactly _ | Anything | Named (Language.Local _) | ListOf _ | SomeItem _ => None
  end.

Fixpoint value_along (l : list text) (v : value) : option value :=
  match l, v with
  | [], _ => Some v
  | f :: l, Object object => match field f object with Some w => value_along l w | None => None end
  | _ :: _, _ => None
  end.

Lemma path_value : forall x b p v l, path x p = Some l -> matches b p v -> value_along l v = Some (b (Rigid x)).
Proof.
  intros x b; induction p as [w | y | | fields IH | items IH | p IH] using pattern_induction; intros v l P M;
    try discriminate.
  - destruct y as [y | y]; [| discriminate]. simpl in P. destruct (Nat.eqb_spec x y); [| discriminate].
    injection P as <-. simpl in *. congruence.
  - destruct M as (object & -> & M). cbn [path] in P. revert l P.
    induction IH as [| [f p] fields H _ IHF]; intros l P; [discriminate |]. destruct M as [(w & F & M) M'].
    destruct (path x p) as [m |] eqn:Q; [| now apply IHF].
    injection P as <-. simpl. rewrite F. now apply H.
Qed.

(** No event matches both patterns, or the variable has one place in both. *)
Definition one_place (x : nat) (p q : pattern) : bool :=
  exclude p q || match path x p, path x q with Some l, Some m => same_list text_eqb l m | _, _ => false end.

Lemma one_place_value : forall x p q a b v, one_place x p q = true -> fits_pattern a p v -> fits_pattern b q v ->
  a x = b x.
Proof.
  intros x p q a b v O (a' & A & M) (b' & B & N). apply orb_true_iff in O as [O | O].
  - exfalso. eapply exclude_sound; eauto.
  - destruct (path x p) as [l |] eqn:P; [| discriminate]. destruct (path x q) as [m |] eqn:Q; [| discriminate].
    apply (same_list_iff _ _ text_eqb_iff) in O. subst m. apply (path_value x a' p v l P) in M.
    apply (path_value x b' q v l Q) in N. rewrite <- A, <- B. congruence.
Qed.

Definition mentions (x : nat) (p : pattern) : bool := Conditions.member x (pattern_variables p).

Definition determined (ps : list pattern) : bool :=
  forallb (fun p => forallb (fun q => forallb (fun x => implb (mentions x q) (one_place x p q)) (pattern_variables p))
    ps) ps.

(** ** The values that an event gives to variables *)

Section Patterns.
Variable ps : list pattern.
Hypothesis ps_determined : determined ps = true.

Definition found (v : value) (x : nat) : option value :=
  match find (fun p => mentions x p && negb (is_nil (bindings p v))) ps with
  | Some p => match bindings p v with bs :: _ => lookup Nat.eqb bs x | [] => None end
  | None => None
  end.

(** An assignment that an event completes, but for hidden variables, which the text does not ask for yet. *)
Definition completed (hidden : list nat) (b : assignment) (e : event) : assignment :=
  fun x => match b x with
    | Some v => Some v
    | None => if Conditions.member x hidden then None else found (content e) x
    end.

Lemma fits_same : forall p q x a b v, In p ps -> In q ps -> mentions x p = true -> mentions x q = true ->
  fits_pattern a p v -> fits_pattern b q v -> a x = b x.
Proof.
  intros p q x a b v P Q X Y F G. unfold determined in ps_determined. rewrite forallb_forall in ps_determined.
  specialize (ps_determined p P). rewrite forallb_forall in ps_determined. specialize (ps_determined q Q).
  rewrite forallb_forall in ps_determined. apply Conditions.member_iff in X. specialize (ps_determined x X).
  rewrite Y in ps_determined. now apply (one_place_value x p q a b v).
Qed.

Lemma found_some : forall v x w, found v x = Some w -> exists p a, In p ps /\ mentions x p = true /\
  fits_pattern a p v /\ a x = w.
Proof.
  intros v x w F. unfold found in F. destruct (find _ ps) as [p |] eqn:Q; [| discriminate].
  apply find_some in Q as [I Q]. apply andb_true_iff in Q as [M N].
  destruct (bindings p v) as [| bs l] eqn:B; [discriminate |].
  assert (J : In bs (bindings p v)) by (rewrite B; simpl; auto).
  exists p, (get Nat.eqb bs). split; [| split; [| split]]; auto.
  - apply bindings_iff. exists bs; split; auto. now apply (bindings_agree p v).
  - unfold get. now rewrite F.
Qed.

Lemma found_fits : forall p a v x, In p ps -> mentions x p = true -> fits_pattern a p v -> found v x = Some (a x).
Proof.
  intros p a v x I M F. assert (S : exists w, found v x = Some w).
  { unfold found. destruct (find _ ps) as [q |] eqn:Q.
    - apply find_some in Q as [J Q]. apply andb_true_iff in Q as [X N].
      destruct (bindings q v) as [| bs l] eqn:B; [discriminate |].
      apply (lookup_bound Nat.eqb Nat.eqb_eq), (bindings_variables q v); [rewrite B; simpl; auto |].
      now apply Conditions.member_iff.
    - apply (find_none _ _ Q) in I. rewrite M in I. apply bindings_iff in F as (bs & J & _).
      destruct (bindings p v); [destruct J | discriminate I]. }
  destruct S as (w & S). rewrite S. apply found_some in S as (q & b & J & X & G & <-).
  f_equal. now apply (fits_same q p x b a v).
Qed.

(** A variable whose patterns all exclude the pattern of an event has no value in it. *)
Lemma found_none : forall p a v x, fits_pattern a p v ->
  forallb (fun q => implb (mentions x q) (exclude p q)) ps = true -> found v x = None.
Proof.
  intros p a v x F X. destruct (found v x) as [w |] eqn:S; auto. exfalso.
  apply found_some in S as (q & b & J & M & G & _). rewrite forallb_forall in X. specialize (X q J).
  rewrite M in X. destruct F as (a' & _ & F), G as (b' & _ & G). eapply exclude_sound; eauto.
Qed.

Lemma completed_grows : forall hidden b e, grows b (completed hidden b e).
Proof. intros hidden b e x v Q. unfold completed. now rewrite Q. Qed.

(** ** What the text follows *)

(** The variables of occurrences. *)
Definition variables_of (t : tree) (d : list occurrence) : list nat := flat_map (fun o => node_variables t (fst o)) d.

(** A guard variable of an occurrence, where [d] is done: it is one of its own, or is followed, or is unbound
    and stays so. *)
Definition guard_variable_fair (shared hidden bound d : list nat) (p : pattern) (x : nat) : bool :=
  mentions x p || (Conditions.member x d && Conditions.member x shared) ||
  (negb (Conditions.member x d) && negb (Conditions.member x bound) &&
   (Conditions.member x hidden || forallb (fun q => implb (mentions x q) (exclude p q)) ps)).

(** The assignment that the text follows agrees with what an occurrence asks for. *)
Definition fair (t : tree) (shared : list nat) (atom_of : occurrence -> option atom) (hidden bound : list nat)
  (d : list occurrence) (o : occurrence) : bool :=
  let done := variables_of t d in
  match atom_of o with
  | Some q =>
    forallb (fun x => Bool.eqb (Conditions.member x bound) (Conditions.member x done) &&
                      implb (Conditions.member x done) (Conditions.member x shared) &&
                      (Conditions.member x done || negb (Conditions.member x hidden)))
      (pattern_variables (atom_pattern q)) &&
    forallb (fun g => forallb (guard_variable_fair shared hidden bound done (atom_pattern q)) (variables g)) (atom_guards q)
  | None => false
  end.

(** ** One scenario *)

Section Scenario.
Variable t : tree.
Variable r : resolution.
Variable timed : occurrence -> bool.
Variable before : occurrence -> occurrence -> bool.
Variable shared : list nat.              (* the variables that the text follows *)

Notation guards := (guards_of t r).
Notation part := (parts t r).
Notation os := (occurrences_of t r).
Notation atom_of := (scenario_atom t timed (scenario_guards t part guards)).

Hypothesis constants : constants_hold guards = true.
Hypothesis simple : basic t = true.
Hypothesis untimed : forall g, In g guards -> points g = [].
Hypothesis unclocked : forall o q, In o os -> atom_of o = Some q -> atom_time q = None.

Variable sat : nat -> sliced -> bool.
Variable required : occurrence -> nat.
Hypothesis required_atom : forall o, In o os -> exists q, atom_of o = Some q /\
  forall y, sat (required o) y = observes q y.
Hypothesis pattern_known : forall o p, In o os -> on (node_at t (fst o)) = Some p -> In p ps.

Notation tree_plan := (Plan os before (consistent t guards part)).
Notation slice_shape := (Shape os before required).
Notation slice_plan := (plain sat slice_shape).

(** All assignments of a partial match agree with the one that the text follows. *)
Definition Follows (b : assignment) (m : assigned event) : Prop :=
  (exists a, Under t guards part a m) /\
  forall a x, Under t guards part a m -> In x shared -> In x (variables_of t (domain m)) -> b x = Some (a x).

Lemma bound_of : forall m, bound_variables t m = variables_of t (domain m).
Proof.
  intros m. unfold bound_variables, variables_of, node_variables. apply flat_map_ext_in. intros o _.
  now rewrite pattern_at_basic.
Qed.

Lemma known_untimed : forall m g, In g guards -> (known t part m g = true <-> incl (variables g) (variables_of t (domain
  m))).
Proof.
  intros m g I. unfold known. rewrite (untimed g I). simpl. rewrite andb_true_r, forallb_forall. split.
  - intros H x X. rewrite <- bound_of. now apply Conditions.member_iff, H.
  - intros H x X. rewrite <- bound_of in H. now apply Conditions.member_iff, H.
Qed.

Lemma guard_same : forall a a' time time' g, In g guards -> (forall x, In x (variables g) -> a x = a' x) ->
  holds a time g = holds a' time' g.
Proof. intros a a' time time' g I H. apply holds_same; auto. rewrite (untimed g I). intros ? []. Qed.

Lemma scenario_guard : forall g, In g guards -> is_constant g = false -> In g (scenario_guards t part guards).
Proof.
  intros g I C. apply in_map_iff. exists g. split; [now apply clocked_untimed, untimed |].
  apply filter_In. now rewrite C.
Qed.

Lemma from_scenario_guard : forall g, In g (scenario_guards t part guards) -> In g guards.
Proof.
  intros g I. apply in_map_iff in I as (h & <- & I). apply filter_In in I as [I _].
  now rewrite clocked_untimed by now apply untimed.
Qed.

Lemma under_rest : forall a o e m, Under t guards part a ((o, e) :: m) -> Under t guards part a m.
Proof.
  intros a o e m [F G]. split; [intros p f I; apply F; simpl; auto |]. intros g I K.
  rewrite <- (G g I); [now apply guard_same |]. apply known_untimed; auto. apply known_untimed in K; auto.
  simpl. now apply incl_appr.
Qed.

Section Serving.
Variable b : assignment.
Variables hidden bound : list nat.
Hypothesis bound_iff : forall x, binds b x = Conditions.member x bound.
Variable m : assigned event.
Hypothesis follows : Follows b m.
Variables (o : occurrence) (e : event).
Hypothesis is_occurrence : In o os.
Hypothesis is_fair : fair t shared atom_of hidden bound (domain m) o = true.

Notation b' := (completed hidden b e).

(** The event serves the occurrence exactly when it satisfies its test under the completed assignment. *)
Lemma served_completed : consistent t guards part ((o, e) :: m) = sat (required o) (e, b').
Proof.
  destruct (required_atom o is_occurrence) as (q & A & SAT). rewrite SAT.
  unfold fair in is_fair. rewrite A in is_fair.
  assert (QT := unclocked o q is_occurrence A). unfold scenario_atom in A.
  destruct (on (node_at t (fst o))) as [p |] eqn:P; [| discriminate]. injection A as <-. cbn [atom_pattern atom_time atom_guards] in *.
  assert (NT : timed o = false) by (destruct (timed o); [discriminate | auto]). rewrite NT in *. clear QT.
  rewrite app_nil_r in *. apply andb_true_iff in is_fair as [FV FG]. rewrite forallb_forall in FV, FG.
  assert (PI := pattern_known o p is_occurrence P).
  assert (VO : variables_of t (domain ((o, e) :: m)) = pattern_variables p ++ variables_of t (domain m)).
  { simpl. unfold node_variables. now rewrite P. }
  destruct follows as [(a0 & U0) FO].
  assert (OLD : forall a x, Under t guards part a m -> In x (pattern_variables p) ->
    (In x (variables_of t (domain m)) /\ b x = Some (a x)) \/
    (~ In x (variables_of t (domain m)) /\ b x = None /\ Conditions.member x hidden = false)).
  { intros a x U X. specialize (FV x X). apply andb_true_iff in FV as [FV HI]. apply andb_true_iff in FV as [EQ SH].
    apply eqb_prop in EQ.
    destruct (Conditions.member x (variables_of t (domain m))) eqn:D.
    - left. apply Conditions.member_iff in D. split; auto. apply FO; auto. now apply Conditions.member_iff.
    - right. split; [intros I; apply Conditions.member_iff in I; congruence |].
      rewrite <- bound_iff in EQ. unfold binds in EQ. simpl in HI. apply negb_true_iff in HI.
      split; auto. now destruct (b x). }
  apply eq_true_iff_eq. rewrite (consistent_under t guards part), observes_iff.
  cbn [atom_pattern atom_time atom_guards]. split.
  - intros (a & U).
    assert (UM := under_rest a o e m U).
    destruct (proj1 U o e) as (L & p' & P' & F); [simpl; auto |].
    rewrite pattern_at_basic, P in P' by exact simple. injection P' as <-.
    assert (V : forall x, In x (pattern_variables p) -> b' x = Some (a x)).
    { intros x X. unfold completed. destruct (OLD a x UM X) as [[_ ->] | (_ & -> & ->)]; auto.
      apply found_fits with p; auto. now apply Conditions.member_iff. }
    split; auto. unfold atom_variables. simpl. rewrite app_nil_r. split; [| split; [| split; [discriminate |]]].
    + intros x X. unfold binds. now rewrite (V x X).
    + apply fits_pattern_same with a; auto. intros x X. unfold values_of. now rewrite (V x X).
    + intros g G. unfold passes. destruct (forallb (binds b') (variables g)) eqn:B; simpl; auto.
      assert (G' := proj1 (proj1 (filter_In _ _ _) G)). assert (IG := from_scenario_guard g G').
      rewrite forallb_forall in B. specialize (FG g G). rewrite forallb_forall in FG.
      assert (VG : forall x, In x (variables g) -> In x (pattern_variables p ++ variables_of t (domain m)) /\ b' x = Some
        (a x)).
      { intros x X. specialize (FG x X). unfold guard_variable_fair in FG. rewrite !orb_true_iff in FG.
        destruct FG as [[M | S] | N].
        - apply Conditions.member_iff in M. split; [apply in_app_iff; auto | auto].
        - apply andb_true_iff in S as [D S]. apply Conditions.member_iff in D, S.
          split; [apply in_app_iff; auto |]. unfold completed. now rewrite (FO a x UM S D).
        - rewrite !andb_true_iff, negb_true_iff in N. destruct N as [[_ N] X'].
          exfalso. apply negb_true_iff in N. rewrite <- bound_iff in N. specialize (B x X).
          unfold binds, completed in *. destruct (b x); [discriminate |].
          destruct (Conditions.member x hidden); [discriminate |]. simpl in X'.
          now rewrite (found_none p a (content e) x F X') in B. }
      rewrite <- (proj2 U g IG).
      * apply guard_same; auto. intros x X. unfold values_of. now rewrite (proj2 (VG x X)).
      * apply known_untimed; auto. rewrite VO. intros x X. now apply VG.
  - intros (L & V & F & _ & G). unfold atom_variables in V. simpl in V. rewrite app_nil_r in V.
    set (a := fun x => if mentions x p then values_of b' x else a0 x).
    assert (AP : forall x, In x (pattern_variables p) -> a x = values_of b' x).
    { intros x X. unfold a. apply Conditions.member_iff in X. unfold mentions. now rewrite X. }
    assert (AM : forall x, In x (variables_of t (domain m)) -> a x = a0 x).
    { intros x D. unfold a. destruct (mentions x p) eqn:M; auto. apply Conditions.member_iff in M.
      destruct (OLD a0 x U0 M) as [[_ Q] | [N _]]; [| contradiction].
      unfold values_of. now rewrite (completed_grows hidden b e x _ Q). }
    exists a. split.
    + intros o' e' [Q | I].
      * injection Q as <- <-. split; auto. exists p. rewrite pattern_at_basic by exact simple. split; auto.
        apply fits_pattern_same with (values_of b'); auto.
        intros x X. now rewrite AP.
      * destruct (proj1 U0 o' e' I) as (L' & p' & P' & F'). split; auto. exists p'; split; auto.
        apply fits_pattern_same with a0; auto. intros x X. symmetry. apply AM. apply in_flat_map. exists o'.
        split; [apply in_domain; eauto |]. unfold node_variables. rewrite pattern_at_basic in P' by exact simple.
        now rewrite P'.
    + intros g I K. apply known_untimed in K; auto. rewrite VO in K.
      destruct (existsb (fun x => mentions x p) (variables g)) eqn:X.
      * assert (C : is_constant g = false).
        { unfold is_constant. destruct (variables g); [discriminate | auto]. }
        assert (CO : concerns (pattern_variables p) g = true) by exact X.
        assert (IG : In g (filter (concerns (pattern_variables p)) (scenario_guards t part guards)))
          by (apply filter_In; split; auto; now apply scenario_guard).
        specialize (FG g IG). rewrite forallb_forall in FG.
        assert (VG : forall x, In x (variables g) -> binds b' x = true /\ a x = values_of b' x).
        { intros x Y. destruct (mentions x p) eqn:M.
          - apply Conditions.member_iff in M. split; auto.
          - specialize (FG x Y). unfold guard_variable_fair in FG. rewrite M in FG. simpl in FG.
            apply K, in_app_iff in Y as [Y | Y]; [apply Conditions.member_iff in Y; unfold mentions in M; congruence |].
            assert (D := proj2 (Conditions.member_iff _ _) Y). rewrite D in FG. simpl in FG. rewrite orb_false_r in FG.
            apply Conditions.member_iff in FG. assert (Q := FO a0 x U0 FG Y).
            apply (completed_grows hidden b e) in Q. unfold binds, values_of. rewrite Q. split; auto. }
        assert (PA := G g IG). unfold passes in PA. apply orb_true_iff in PA as [PA | PA].
        -- apply negb_true_iff in PA. rewrite <- not_true_iff_false in PA. exfalso. apply PA, forallb_forall.
           intros x Y. now apply VG.
        -- rewrite <- PA. apply guard_same; auto. intros x Y. now apply VG.
      * assert (KM : incl (variables g) (variables_of t (domain m))).
        { intros x Y. assert (Z := K x Y). apply in_app_iff in Z as [Z | Z]; auto. exfalso.
          rewrite <- not_true_iff_false in X. apply X, existsb_exists. exists x; split; auto.
          now apply Conditions.member_iff. }
        rewrite <- (proj2 U0 g I) by now apply known_untimed. apply guard_same; auto.
Qed.

(** What is served agrees with an assignment that keeps the values of the event for followed variables. *)
Lemma serving_follows : forall c, consistent t guards part ((o, e) :: m) = true -> grows b c ->
  (forall x v, c x = Some v -> b' x = Some v) ->
  (forall x, In x shared -> In x (variables_of t (domain ((o, e) :: m))) -> binds c x = true) ->
  Follows c ((o, e) :: m).
Proof.
  intros c C G W B. split; [now apply (consistent_under t guards part) |]. intros a x U S X.
  assert (UM := under_rest a o e m U).
  specialize (B x S X). unfold binds in B. destruct (c x) as [v |] eqn:Q; [| discriminate]. f_equal.
  apply W in Q. simpl in X. apply in_app_iff in X as [X | X].
  - destruct (proj1 U o e) as (L & p & P & F); [simpl; auto |]. rewrite pattern_at_basic in P by exact simple.
    unfold node_variables in X. rewrite P in X.
    unfold completed in Q. destruct (b x) as [w |] eqn:BX.
    + injection Q as ->. destruct (in_dec Nat.eq_dec x (variables_of t (domain m))) as [D | D].
      * apply (proj2 follows a x UM S) in D. congruence.
      * exfalso. unfold fair in is_fair. unfold scenario_atom in is_fair. rewrite P in is_fair. simpl in is_fair.
        apply andb_true_iff in is_fair as [FV _]. rewrite forallb_forall in FV. specialize (FV x X).
        rewrite !andb_true_iff in FV. destruct FV as [[EQ _] _]. apply eqb_prop in EQ. rewrite <- bound_iff in EQ.
        unfold binds in EQ. rewrite BX in EQ. apply D. now apply Conditions.member_iff.
    + destruct (Conditions.member x hidden); [discriminate |].
      rewrite (found_fits p a (content e) x) in Q; auto; [congruence | now apply pattern_known with o |].
      now apply Conditions.member_iff.
  - apply (proj2 follows a x UM S) in X. apply (completed_grows hidden b e) in X. congruence.
Qed.
End Serving.

(** What is not served agrees with every extension. *)
Lemma growing_follows : forall b c m, Follows b m -> grows b c -> Follows c m.
Proof. intros b c m [E F] G. split; auto. Qed.

(** *** The search *)

Hypothesis relevant_same : forall y, sat relevance y = relevant_event t (fst y).

Notation tree_step s := (step (relevant_event t) s tree_plan).
Notation slice_step s := (step (relevant sat) s slice_plan).

Lemma nothing_follows : forall b, Follows b [].
Proof.
  intros b. split; [| intros a x _ _ []]. exists (fun _ => Null). split; [intros p f [] |]. intros g I K.
  apply known_untimed in K; auto. assert (V : variables g = []).
  { destruct (variables g) as [| x l]; auto. destruct (K x); simpl; auto. }
  unfold constants_hold in constants. rewrite forallb_forall in constants. rewrite <- (constants g).
  - apply guard_same; auto.
  - apply filter_In; split; auto. unfold is_constant. now rewrite V, untimed.
Qed.

Lemma start_followed : start tree_plan = map forget (start slice_plan).
Proof.
  unfold start. cbn [plan_consistent forallb]. destruct (nothing_follows unbound) as [U _].
  apply (consistent_under t guards part) in U. now rewrite U.
Qed.

Section Step.
Variable b : assignment.
Variables hidden bound : list nat.
Hypothesis bound_iff : forall x, binds b x = Conditions.member x bound.
Variable l : list (assigned sliced).
Hypothesis l_follow : forall m, In m l -> Follows b (forget m).
Hypothesis l_consistent : Consistents sat slice_shape l.
Hypothesis l_fair : forall m o, In m l -> In o os -> ready slice_shape (domain m) o = true ->
  fair t shared atom_of hidden bound (domain m) o = true.
Variable e : event.
Notation y := (e, completed hidden b e).

Lemma extend_followed : forall m, In m l -> extend tree_plan e (forget m) = map forget (extend slice_plan y m).
Proof.
  intros m I. unfold extend. cbn [plan_occurrences plan_before plan_consistent].
  assert (X : forall k, incl k os -> flat_map (fun o =>
      if negb (among o (domain (forget m))) && forallb (fun p => implb (before p o) (among p (domain (forget m)))) os &&
         consistent t guards part ((o, e) :: forget m) then [(o, e) :: forget m] else []) k =
    map forget (flat_map (fun o =>
      if negb (among o (domain m)) && forallb (fun p => implb (before p o) (among p (domain m))) os &&
         forallb (fun z => sat (required (fst z)) (snd z)) ((o, y) :: m) then [(o, y) :: m] else []) k));
    [| apply X, incl_refl].
  induction k as [| o k IH]; intros K; auto. cbn [flat_map]. rewrite map_app, IH by (intros z Z; apply K; simpl; auto).
  f_equal. rewrite forget_domain. assert (O : In o os) by (apply K; simpl; auto).
  destruct (negb (among o (domain m)) && _) eqn:R; simpl andb; auto. cbn [forallb fst snd].
  assert (C := l_consistent m I). simpl in C. rewrite C, andb_true_r.
  assert (F := l_fair m o I O R). rewrite <- (forget_domain m) in F.
  rewrite (served_completed b hidden bound bound_iff (forget m) (l_follow m I) o e O F).
  destruct (sat (required o) y); auto.
Qed.

Lemma step_followed : forall s, tree_step s e (map forget l) = map forget (slice_step s y l).
Proof.
  intros s. assert (X : flat_map (extend tree_plan e) (map forget l) = map forget (flat_map (extend slice_plan y) l)).
  { assert (Y : forall k, incl k l -> flat_map (extend tree_plan e) (map forget k) =
      map forget (flat_map (extend slice_plan y) k)); [| apply Y, incl_refl].
    induction k as [| m k IH]; intros K; auto. cbn [flat_map map].
    rewrite map_app, IH, extend_followed; auto; [apply K; simpl; auto | intros z Z; apply K; simpl; auto]. }
  assert (R : relevant sat y = relevant_event t e) by apply relevant_same.
  destruct s; unfold step; rewrite ?R, ?X; auto.
  - now destruct (relevant_event t e).
  - destruct (relevant_event t e); auto. now rewrite map_app, start_followed.
  - now rewrite map_app.
Qed.

Lemma step_follows : forall s c, grows b c -> (forall x v, c x = Some v -> completed hidden b e x = Some v) ->
  (forall m x, In m (slice_step s y l) -> In x shared -> In x (variables_of t (domain m)) -> binds c x = true) ->
  forall m, In m (slice_step s y l) -> Follows c (forget m).
Proof.
  intros s c G W B m I. assert (J := I). apply (in_step_plain sat) in J as [[J _] | [(_ & _ & ->) | (_ & m0 & o & J &
    -> & O & R & S)]]; auto.
  - now apply growing_follows with b; auto.
  - apply nothing_follows.
  - assert (F := l_fair m0 o J O R). rewrite <- (forget_domain m0) in F.
    apply (serving_follows b hidden bound bound_iff (forget m0) (l_follow m0 J) o e O F); auto.
    + now rewrite (served_completed b hidden bound bound_iff (forget m0) (l_follow m0 J) o e O F).
    + intros x X V. apply (B ((o, y) :: m0) x I X). simpl in *. now rewrite forget_domain in V.
Qed.
End Step.
End Scenario.
End Patterns.

(** ** The scenarios of a tree *)

Record scene := Scene { scene_plan : plan event; scene_shape : shape; scene_atom : occurrence -> option atom }.

Section Tree.
Variable t : tree.
Variable w : selection.
Variable ps : list predicate.
Variable qs : list atom.
Variable shared : list nat.

Notation sat := (slice_satisfies t ps qs).
Notation patterns := (map atom_pattern qs).

Definition scenes : list scene :=
  let timed := timed_in t w in
  selected_scenarios (fun guards part os before =>
    let asked := scenario_guards t part guards in
    Scene (Plan os before (consistent t guards part)) (slice_shape t ps qs timed guards part os before)
      (scenario_atom t timed asked)) t w.

(** No guard is about time, and all atoms are numbered. *)
Definition all_untimed : bool :=
  basic t && forallb (fun b => b) (selected_scenarios (fun guards _ _ _ => forallb (fun g => is_nil (points g)) guards) t w) &&
  forallb (forallb (fun q => match atom_time q with None => true | Some _ => false end)) (shape_atoms t w).

Hypothesis well : WellFormed t.
Hypothesis untimed : all_untimed = true.
Hypothesis atoms_placed : all_placed t qs w = true.
Hypothesis patterns_determined : determined patterns = true.
Variable s : semantics.

Notation tree_states c := (states (relevant_event t) s (scene_plan c)).
Notation slice_states c := (states (relevant sat) s (plain sat (scene_shape c))).

Lemma untimed_basic : basic t = true.
Proof. assert (U := untimed). unfold all_untimed in U. rewrite !andb_true_iff in U. apply U. Qed.

Lemma scene_plans : map scene_plan scenes = plans t w.
Proof. unfold scenes. cbv zeta. now rewrite map_scenarios. Qed.

Lemma scene_shapes : map scene_shape scenes = slice_shapes t ps qs w.
Proof. unfold scenes. cbv zeta. now rewrite map_scenarios. Qed.

(** The assignment with these variables is fair to all partial matches. *)
Definition Fair (hidden bound : list nat) (p : list sliced) : Prop := forall c m, In c scenes -> In m (slice_states c p) ->
  (forall x, In x shared -> In x (variables_of t (domain m)) -> In x bound) /\
  (forall o, In o (shape_occurrences (scene_shape c)) -> ready (scene_shape c) (domain m) o = true ->
     fair patterns t shared (scene_atom c) hidden bound (domain m) o = true).

(** A trace, seen under assignments that its events complete; of each event some values are kept. *)
Inductive Followed : list event -> list sliced -> assignment -> list nat -> list nat -> Prop :=
| followed_start : forall hidden, Fair hidden [] [] -> Followed [] [] unbound hidden []
| followed_event : forall u p b hidden bound e c hidden' bound', Followed u p b hidden bound -> grows b c ->
    (forall x v, c x = Some v -> completed patterns hidden b e x = Some v) ->
    (forall x, binds c x = Conditions.member x bound') ->
    Fair hidden' bound' (p ++ [(e, completed patterns hidden b e)]) ->
    Followed (u ++ [e]) (p ++ [(e, completed patterns hidden b e)]) c hidden' bound'.

Lemma followed_bound : forall u p b hidden bound, Followed u p b hidden bound -> forall x, binds b x = Conditions.member x bound.
Proof. intros u p b hidden bound F. destruct F; auto. Qed.

Lemma followed_fair : forall u p b hidden bound, Followed u p b hidden bound -> Fair hidden bound p.
Proof. intros u p b hidden bound F. destruct F; auto. Qed.

(** What each scene is. *)
Lemma scene_facts : forall c, In c scenes -> exists r before,
  let guards := guards_of t r in
  let timed := timed_in t w in
  let atom_of := scenario_atom t timed (scenario_guards t (parts t r) guards) in
  let required := fun o => match atom_of o with Some q => atom_number ps qs q | None => relevance end in
  c = Scene (Plan (occurrences_of t r) before (consistent t guards (parts t r)))
        (Shape (occurrences_of t r) before required) atom_of /\
  constants_hold guards = true /\ (forall g, In g guards -> points g = []) /\
  forall o, In o (occurrences_of t r) -> exists q, atom_of o = Some q /\ atom_time q = None /\
    (forall y, sat (required o) y = observes q y) /\ In q qs.
Proof.
  intros c I. apply in_scenarios in I as (r & chosen & R & S & C & L & A & ->). cbv zeta in *.
  exists r, (precedes (node_pairs t r) (end_pairs t r (last_in chosen))). split; [reflexivity |]. split; [exact C |].
  assert (UT := untimed). unfold all_untimed in UT. rewrite !andb_true_iff in UT. destruct UT as [[_ U] T].
  rewrite forallb_forall in U, T. split.
  - assert (G : forallb (fun g => is_nil (points g)) (guards_of t r) = true)
      by (apply U, in_scenarios; exists r, chosen; repeat split; auto).
    rewrite forallb_forall in G.
    intros g I. now apply is_nil_iff, G.
  - intros o O. destruct (occurrence_atom t w r chosen o R S C L A O) as (q & l & Q & IL & IQ).
    exists q. split; auto. unfold all_placed in atoms_placed. rewrite forallb_forall in atoms_placed.
    assert (PL := atoms_placed l IL). assert (TL := T l IL). rewrite forallb_forall in PL, TL. split; [| split].
    + apply TL in IQ. now destruct (atom_time q).
    + intros y. rewrite Q. now apply atom_satisfied, PL.
    + apply PL, Nat.ltb_lt, place_nth in IQ. now apply nth_error_In in IQ.
Qed.

(** *** The partial matches of one scene *)

Section Scene.
Variable c : scene.
Hypothesis c_scene : In c scenes.

Lemma scene_followed : exists Follow : assignment -> assigned event -> Prop,
  forall u p b hidden bound, Followed u p b hidden bound -> (forall m, In m (slice_states c p) -> Follow b (forget m)) /\
    tree_states c u = map forget (slice_states c p) /\
    forall e, tree_states c (u ++ [e]) = map forget (slice_states c (p ++ [(e, completed patterns hidden b e)])).
Proof.
  destruct (scene_facts c c_scene) as (r & before & Q & C & U & O). cbv zeta in *. exists (Follows t r shared).
  set (timed := timed_in t w) in *.
  set (required := fun o => match scenario_atom t timed (scenario_guards t (parts t r) (guards_of t r)) o with
    Some q => atom_number ps qs q | None => relevance end) in *.
  assert (UC : forall o q, In o (occurrences_of t r) ->
    scenario_atom t timed (scenario_guards t (parts t r) (guards_of t r)) o = Some q -> atom_time q = None).
  { intros o q I A. destruct (O o I) as (q' & A' & T & _). rewrite A in A'. now injection A' as <-. }
  assert (RQ : forall o, In o (occurrences_of t r) -> exists q,
    scenario_atom t timed (scenario_guards t (parts t r) (guards_of t r)) o = Some q /\
    forall y, sat (required o) y = observes q y).
  { intros o I. destruct (O o I) as (q & A & _ & S & _). eauto. }
  assert (PK : forall o p, In o (occurrences_of t r) -> on (node_at t (fst o)) = Some p -> In p patterns).
  { intros o p I P. destruct (O o I) as (q & A & _ & _ & J). unfold scenario_atom in A. rewrite P in A.
    injection A as A. apply (in_map atom_pattern) in J. now rewrite <- A in J. }
  assert (NEXT : forall u p b hidden bound, Followed u p b hidden bound -> (forall m, In m (slice_states c p) -> Follows t r shared
    b (forget m)) -> tree_states c u = map forget (slice_states c p) ->
    forall e, tree_states c (u ++ [e]) = map forget (slice_states c (p ++ [(e, completed patterns hidden b e)]))).
  { intros u p b hidden bound F L S e. rewrite !states_snoc, S. rewrite Q in *. cbn [scene_plan scene_shape scene_atom] in *.
    apply (step_followed patterns patterns_determined t r timed before shared C untimed_basic U UC sat required RQ PK
      (slice_relevant t ps qs) b hidden bound (followed_bound u p b hidden bound F)); auto.
    - apply states_consistent.
    - intros m o I J R. apply (followed_fair u p b hidden bound F _ m c_scene I); auto. }
  intros u p b hidden bound F. assert (B : (forall m, In m (slice_states c p) -> Follows t r shared b (forget m)) /\
    tree_states c u = map forget (slice_states c p)); [| destruct B; split; [| split]; eauto].
  induction F as [hidden F0 | u p b hidden bound e b' hidden' bound' F [IHF IHS] G W B FA]; split.
  - intros m I. rewrite Q in I. destruct I as [<- | []].
    apply (nothing_follows t r shared); auto using untimed_basic.
  - rewrite Q. apply (start_followed t r before shared C untimed_basic U sat required).
  - intros m I. rewrite states_snoc in I. assert (FA' := FA c). rewrite Q in *.
    cbn [scene_plan scene_shape scene_atom] in *.
    apply (step_follows patterns patterns_determined t r timed before shared C untimed_basic U UC sat required RQ PK
      b hidden bound (followed_bound u p b hidden bound F) _ IHF) with (s := s) (e := e); auto.
    + apply states_consistent.
    + intros m' o J K R. apply (followed_fair u p b hidden bound F _ m' c_scene J); auto.
    + intros m' x J X V. rewrite B. apply Conditions.member_iff. rewrite <- states_snoc in J.
      now apply (proj1 (FA' m' c_scene J)).
  - now apply (NEXT _ _ _ hidden bound).
Qed.
End Scene.

(** *** The verdict *)

Notation tree_plans := (map scene_plan scenes).
Notation slice_plans := (map (fun c => plain sat (scene_shape c)) scenes).

Definition SameStates (u : list event) (p : list sliced) : Prop :=
  forall c, In c scenes -> tree_states c u = map forget (slice_states c p).

(** Both searches are done, or both go on. *)
Definition Alike (u : list event) (p : list sliced) : Prop :=
  (run (relevant_event t) s tree_plans u = Done /\ run (relevant sat) s slice_plans p = Done) \/
  (run (relevant_event t) s tree_plans u = Running (snapshot (relevant_event t) s tree_plans u) /\
   run (relevant sat) s slice_plans p = Running (snapshot (relevant sat) s slice_plans p)).

Lemma same_full : forall u p, SameStates u p ->
  existsb (fun c => existsb (full c) (states (relevant_event t) s c u)) tree_plans =
  existsb (fun c => existsb (full c) (states (relevant sat) s c p)) slice_plans.
Proof.
  intros u p H. rewrite !existsb_map. apply existsb_ext_in. intros c I. rewrite (H c I), existsb_map.
  apply existsb_ext_in. intros m _. destruct (scene_facts c I) as (r & before & -> & _). unfold full. simpl.
  now rewrite forget_domain.
Qed.

Lemma alike_step : forall u p e y, Alike u p -> SameStates (u ++ [e]) (p ++ [y]) -> Alike (u ++ [e]) (p ++ [y]).
Proof.
  intros u p e y A H. unfold Alike in *. rewrite !run_snoc. destruct A as [[-> ->] | [-> ->]]; [left; auto |].
  cbn [advance]. rewrite <- (snapshot_snoc (relevant_event t)), <- (snapshot_snoc (relevant sat)).
  rewrite !settle_snapshot, (same_full _ _ H).
  destruct (existsb _ slice_plans); [left | right]; auto.
Qed.

Lemma alike_verdict : forall u p, Alike u p -> SameStates u p ->
  verdict_of (run (relevant_event t) s tree_plans u) = verdict_of (run (relevant sat) s slice_plans p).
Proof.
  intros u p [[-> ->] | [-> ->]] H; auto. cbn [verdict_of]. unfold snapshot. rewrite !forallb_map. cbn [fst snd].
  assert (X : forallb (fun c => is_nil (tree_states c u)) scenes = forallb (fun c => is_nil (slice_states c p)) scenes).
  { apply forallb_ext_in. intros c I. rewrite (H c I). now destruct (slice_states c p). }
  cbn [snd]. now rewrite X.
Qed.

Lemma followed_alike : forall u p b hidden bound, Followed u p b hidden bound -> Alike u p /\ SameStates u p /\
  forall e, SameStates (u ++ [e]) (p ++ [(e, completed patterns hidden b e)]).
Proof.
  assert (SS : forall u p b hidden bound, Followed u p b hidden bound -> SameStates u p /\
    forall e, SameStates (u ++ [e]) (p ++ [(e, completed patterns hidden b e)])).
  { intros u p b hidden bound F. split; [intros c I | intros e c I];
      destruct (scene_followed c I) as (Follow & H); now apply (H u p b hidden bound F). }
  intros u p b hidden bound F. split; [| now apply (SS u p b hidden bound)]. induction F as [hidden F0 | u p b hidden bound e b' hidden' bound' F IH G W B FA].
  - assert (S := proj1 (SS _ _ _ _ _ (followed_start hidden F0))). unfold Alike.
    change (run (relevant_event t) s tree_plans []) with (settle (snapshot (relevant_event t) s tree_plans [])).
    change (run (relevant sat) s slice_plans []) with (settle (snapshot (relevant sat) s slice_plans [])).
    rewrite !settle_snapshot, (same_full _ _ S). destruct (existsb _ slice_plans); [left | right]; auto.
  - apply alike_step; auto. now apply (SS u p b hidden bound).
Qed.

Variable numbers : list nat.
Hypothesis relevance_numbered : In relevance numbers.
Hypothesis shapes_numbered : Forall (well_lettered numbers) (slice_shapes t ps qs w).

Notation reached := (automaton_after sat numbers s (slice_shapes t ps qs w)).

Lemma alike_correct : forall u p, Alike u p -> SameStates u p -> VerdictOfTree t w s u (verdict_at (reached p)).
Proof.
  intros u p A S. apply (tree_plans_verdict t w well untimed_basic). rewrite automaton_verdict by auto.
  rewrite <- scene_shapes, map_map, <- (alike_verdict u p A S), scene_plans. apply verdict_correct.
  now apply plans_lawful.
Qed.

(** The automaton has the verdict of the tree after what is followed, and one event more. *)
Theorem followed_verdict : forall u p b hidden bound, Followed u p b hidden bound ->
  VerdictOfTree t w s u (verdict_at (reached p)) /\
  forall e, VerdictOfTree t w s (u ++ [e]) (verdict_at (reached (p ++ [(e, completed patterns hidden b e)]))).
Proof.
  intros u p b hidden bound F. destruct (followed_alike u p b hidden bound F) as (A & S & N).
  split; [now apply alike_correct |]. intros e. apply alike_correct; auto. now apply alike_step.
Qed.

(** *** What is fair to the states of the automaton is fair to the partial matches *)

(** Under [scattered] a state has only the greatest sets of done occurrences, so nothing is followed there. *)
Definition scene_fair (hidden bound : list nat) (c : scene) (d : list occurrence) : bool :=
  let os := shape_occurrences (scene_shape c) in
  match s with
  | Scattered =>
    is_nil bound && forallb (fun x => negb (Conditions.member x shared)) (variables_of t os) &&
    forallb (fun o => fair patterns t shared (scene_atom c) hidden [] (filter (fun p => negb (same p o)) os) o) os
  | Strict | Projected | Consecutive =>
    forallb (fun x => implb (Conditions.member x shared) (Conditions.member x bound)) (variables_of t d) &&
    forallb (fun o => implb (ready (scene_shape c) d o) (fair patterns t shared (scene_atom c) hidden bound d o)) os
  end.

Definition fair_state (cs : list scene) (hidden bound : list nat) (q : state) : bool :=
  match q with
  | Accepting => true
  | Watching sets => forallb (fun b => b) (map2 (fun c l => forallb (scene_fair hidden bound c) l) cs sets)
  end.

Lemma fair_below : forall atom_of hidden bound d d' o, incl (variables_of t d') (variables_of t d) ->
  (incl (variables_of t d) (variables_of t d') \/
   bound = [] /\ forall x, In x (variables_of t d) -> In x shared -> False) ->
  fair patterns t shared atom_of hidden bound d o = true -> fair patterns t shared atom_of hidden bound d' o = true.
Proof.
  intros atom_of hidden bound d d' o I C F. unfold fair in *. destruct (atom_of o) as [q |]; auto.
  apply andb_true_iff in F as [V G]. rewrite forallb_forall in V, G. apply andb_true_iff; split; apply forallb_forall.
  - intros x X. specialize (V x X). rewrite !andb_true_iff in V. destruct V as [[E S] H]. apply eqb_prop in E.
    destruct (Conditions.member x (variables_of t d')) eqn:M.
    + apply Conditions.member_iff, I, Conditions.member_iff in M. rewrite M in *. now rewrite E, S.
    + simpl. rewrite andb_true_r. assert (N : Conditions.member x (variables_of t d) = false).
      { destruct (Conditions.member x (variables_of t d)) eqn:D; auto. destruct C as [C | [-> N]].
        - apply Conditions.member_iff, C, Conditions.member_iff in D. congruence.
        - exfalso. apply (N x); now apply Conditions.member_iff. }
      rewrite N in *. rewrite E. exact H.
  - intros g K. specialize (G g K). rewrite forallb_forall in *. intros x X. specialize (G x X).
    unfold guard_variable_fair in *. rewrite !orb_true_iff, !andb_true_iff, !negb_true_iff in *.
    destruct G as [[M | [D S]] | [[N B] X']]; auto.
    + destruct C as [C | [_ N]]; [| exfalso; eapply N; apply Conditions.member_iff; eauto].
      left; right; split; auto. now apply Conditions.member_iff, C, Conditions.member_iff.
    + right; repeat split; auto. apply not_true_iff_false in N. apply not_true_iff_false. intros D. apply N.
      now apply Conditions.member_iff, I, Conditions.member_iff.
Qed.

Lemma fair_state_fair : forall hidden bound p, verdict_at (reached p) = Unknown ->
  fair_state scenes hidden bound (reached p) = true -> Fair hidden bound p.
Proof.
  intros hidden bound p V F c m I J.
  destruct (automaton_run sat numbers s (slice_shapes t ps qs w) p relevance_numbered shapes_numbered) as
    [[Q _] | [Q _]]; rewrite Q in *; [discriminate |]. clear V. simpl in F. rewrite <- scene_shapes, map_map in F.
  rewrite <- (map_id scenes) in F at 1. rewrite map2_map, forallb_map, forallb_forall in F. specialize (F c I).
  rewrite forallb_forall in F.
  assert (W : well_lettered numbers (scene_shape c)).
  { rewrite Forall_forall in shapes_numbered. apply shapes_numbered. rewrite <- scene_shapes. now apply in_map. }
  destruct (proj2 (sets_cover sat numbers s (scene_shape c) p relevance_numbered W) m J) as (d & D & BE).
  specialize (F d D). apply below_iff in BE. unfold scene_fair in F. cbv zeta in F.
  assert (DM : incl (domain m) (shape_occurrences (scene_shape c))).
  { apply states_sound in J as (pos & P & _); [| apply plain_lawful]. apply (of_scenario _ _ _ _ P). }
  destruct (match s with Scattered => true | _ => false end) eqn:SC.
  - destruct s; try discriminate. rewrite !andb_true_iff in F. destruct F as [[BN SH] FA].
    apply is_nil_iff in BN. subst bound. rewrite forallb_forall in SH, FA.
    assert (NS : forall l, incl l (shape_occurrences (scene_shape c)) -> forall x, In x (variables_of t l) ->
      In x shared -> False).
    { intros l L x X S. assert (Y : In x (variables_of t (shape_occurrences (scene_shape c)))).
      { apply in_flat_map in X as (o & O & X). apply in_flat_map. eauto. }
      specialize (SH x Y). apply Conditions.member_iff in S. now rewrite S in SH. }
    split; [intros x S X; exfalso; now apply (NS (domain m) DM x) |]. intros o O R. specialize (FA o O).
    unfold ready in R. apply andb_true_iff in R as [N _]. apply negb_true_iff in N.
    apply fair_below with (filter (fun p => negb (same p o)) (shape_occurrences (scene_shape c))); auto.
    + intros x X. apply in_flat_map in X as (p' & P & X). apply in_flat_map. exists p'. split; auto.
      apply filter_In. split; [auto |]. apply negb_true_iff, same_false. intros ->.
      apply among_iff in P. congruence.
    + right. split; auto. apply NS. intros z Z. now apply filter_In in Z.
  - assert (CA := canon_agree (scene_shape c) (domain m)).
    assert (DC : d = canon (scene_shape c) (domain m)) by (destruct s; try discriminate; congruence).
    assert (F' : forallb (fun x => implb (Conditions.member x shared) (Conditions.member x bound)) (variables_of t d) &&
      forallb (fun o => implb (ready (scene_shape c) d o) (fair patterns t shared (scene_atom c) hidden bound d o))
        (shape_occurrences (scene_shape c)) = true) by (destruct s; [exact F | exact F | exact F | discriminate]).
    apply andb_true_iff in F' as [SH FA]. rewrite forallb_forall in SH, FA. clear F.
    assert (IN : incl (variables_of t (domain m)) (variables_of t d) /\ incl (variables_of t d) (variables_of t (domain
      m))).
    { subst d. split; intros x X; apply in_flat_map in X as (o & O & X); apply in_flat_map; exists o; split; auto.
      - now apply (CA o (DM o O)).
      - apply filter_In in O as [_ O]. now apply among_iff. }
    split.
    + intros x S X. specialize (SH x (proj1 IN x X)). apply Conditions.member_iff in S. rewrite S in SH.
      now apply Conditions.member_iff.
    + intros o O R. specialize (FA o O). apply fair_below with d; [apply IN | left; apply IN |].
      assert (RD : ready (scene_shape c) d o = true) by (subst d; rewrite <- R; now apply ready_agree).
      now rewrite RD in FA.
Qed.
End Tree.
