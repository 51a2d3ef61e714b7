(** * The scenarios of a tree, seen under assignments

    Beside each event of a slice stands an assignment, so an occurrence has one test: its pattern under
    the assignment, and all guards of the scenario that concern its variables.  Scenarios are then plain
    ([Plain.v]), whatever variables nodes share.  [sliced_detected], [sliced_left]: a trace has a match (a
    partial match) in the tree when one of its slices has a match (a partial match) in these scenarios. *)

Require Import List Bool Arith ZArith Lia.
Require Import RVAFT.Values RVAFT.Language RVAFT.Definition RVAFT.Search RVAFT.Conditions RVAFT.Scenarios.
Require Import RVAFT.Monitor RVAFT.Plain RVAFT.Automaton RVAFT.PlainTree RVAFT.Slices RVAFT.Clocks.
Import ListNotations.

(** ** Variables for times *)

Definition tree_variables (t : tree) : list nat :=
  flat_map (fun n => node_variables t n ++ flat_map variables (conditions t n)) (seq 0 (length (nodes t))).

(** The variable for the time of an occurrence is no variable of the tree. *)
Definition clock (t : tree) (o : occurrence) : nat :=
  S (list_max (tree_variables t)) + (length (nodes t) * snd o + fst o).
Arguments clock : simpl never.

Lemma clock_new : forall t o x, In x (tree_variables t) -> x <> clock t o.
Proof.
  intros t o x I. assert (x <= list_max (tree_variables t)); [| unfold clock; lia].
  assert (F := proj1 (list_max_le (tree_variables t) _) (le_n _)). rewrite Forall_forall in F. auto.
Qed.

Lemma clock_one : forall t o p, fst o < length (nodes t) -> fst p < length (nodes t) -> clock t o = clock t p ->
  o = p.
Proof.
  intros t [n i] [m j] L M Q. unfold clock in Q. simpl in *.
  assert (Z : length (nodes t) * i + n = length (nodes t) * j + m) by lia.
  apply Nat.div_mod_unique in Z; auto. destruct Z; congruence.
Qed.

Lemma in_tree_variables : forall t n x, n < length (nodes t) ->
  In x (node_variables t n) \/ (exists g, In g (conditions t n) /\ In x (variables g)) -> In x (tree_variables t).
Proof.
  intros t n x L H. apply in_flat_map. exists n. split; [apply in_seq; lia |]. apply in_app_iff.
  destruct H as [H | (g & I & J)]; auto. right. apply in_flat_map; eauto.
Qed.

(** ** The atoms of a scenario *)

(** The guards of a scenario, with variables for time points. *)
Definition scenario_guards (t : tree) (part : nat -> list occurrence) (guards : list guard) : list guard :=
  map (clocked (clock t) part) (filter (fun g => negb (is_constant g)) guards).

(** A guard concerns an occurrence when it has one of its variables. *)
Definition concerns (xs : list nat) (g : guard) : bool := existsb (fun x => Conditions.member x xs) (variables g).

(** The atom of an occurrence; [timed] are the occurrences whose time has a variable. *)
Definition scenario_atom (t : tree) (timed : occurrence -> bool) (guards : list guard) (o : occurrence) : option
  atom :=
  option_map (fun p =>
    let own := if timed o then Some (clock t o) else None in
    SlicedAtom p own (filter (concerns (pattern_variables p ++ match own with Some x => [x] | None => [] end))
      guards))
    (on (node_at t (fst o))).

(** Time points stand where null is undefined, and their occurrences have variables. *)
Definition guards_timed (t : tree) (timed : occurrence -> bool) (part : nat -> list occurrence) (guards : list guard)
  : bool :=
  forallb (fun g => timely g &&
    forallb (fun p => negb (is_nil (asked_by part p)) &&
      forallb (fun o => timed o && (fst o <? length (nodes t))) (asked_by part p)) (points g)) guards.

Section Scenario.
Variable t : tree.
Variable r : resolution.
Variable timed : occurrence -> bool.
Variable before : occurrence -> occurrence -> bool.
Hypothesis resolution : Resolution t r.
Hypothesis constants : constants_hold (guards_of t r) = true.
Hypothesis simple : basic t = true.

Notation guards := (guards_of t r).
Notation part := (parts t r).
Notation os := (occurrences_of t r).
Notation clocked_guards := (scenario_guards t part guards).
Notation atom_of := (scenario_atom t timed clocked_guards).

Hypothesis timed_guards : guards_timed t timed part guards = true.

Variable sat : nat -> sliced -> bool.
Variable required : occurrence -> nat.
Hypothesis required_atom : forall o, In o os -> exists q, atom_of o = Some q /\
  forall y, sat (required o) y = observes q y.

Notation tree_plan := (Plan os before (consistent t guards part)).
Notation slice_plan := (plain sat (Shape os before required)).

Lemma guard_timed : forall g, In g guards -> timely g = true /\
  forall p, In p (points g) -> asked_by part p <> [] /\
    forall o, In o (asked_by part p) -> timed o = true /\ fst o < length (nodes t).
Proof.
  intros g I. unfold guards_timed in timed_guards. rewrite forallb_forall in timed_guards. apply timed_guards in I.
  apply andb_true_iff in I as [T P]. split; auto. rewrite forallb_forall in P. intros p J. apply P in J.
  apply andb_true_iff in J as [N J]. rewrite forallb_forall in J. split.
  - intros Q. rewrite Q in N. discriminate.
  - intros o O. apply J, andb_true_iff in O as [O L]. split; auto. now apply Nat.ltb_lt.
Qed.

Lemma node_bound : forall n, In n (map fst r) -> n < length (nodes t).
Proof. intros n I. now apply (proj2 (proj2 resolution) n). Qed.

Lemma occurrence_bound : forall o, In o os -> fst o < length (nodes t).
Proof. intros o I. apply occurrences_iff in I as [I _]. now apply node_bound. Qed.

(** A variable of the tree is no clock. *)
Lemma pattern_no_clock : forall o p x c, In o os -> on (node_at t (fst o)) = Some p -> In x (pattern_variables p) ->
  x <> clock t c.
Proof.
  intros o p x c I P X. apply clock_new. apply (in_tree_variables t (fst o)); [now apply occurrence_bound |].
  left. unfold node_variables. now rewrite P.
Qed.

Lemma guard_no_clock : forall g x c, In g guards -> In x (variables g) -> x <> clock t c.
Proof.
  intros g x c I X. apply guards_of_iff in I as (n & N & I). rewrite guards_at_basic in I by auto. apply clock_new.
  apply (in_tree_variables t n); [now apply node_bound |]. right. eauto.
Qed.

Lemma in_scenario_guards : forall g', In g' clocked_guards <->
  exists g, In g guards /\ is_constant g = false /\ g' = clocked (clock t) part g.
Proof.
  intros g'. unfold scenario_guards. rewrite in_map_iff. split.
  - intros (g & <- & I). apply filter_In in I as [I N]. apply negb_true_iff in N. eauto.
  - intros (g & I & N & ->). exists g; split; auto. apply filter_In. now rewrite N.
Qed.

(** What the test of an occurrence says. *)
Lemma sat_iff : forall o e b, In o os -> (sat (required o) (e, b) = true <->
  exists p, on (node_at t (fst o)) = Some p /\ late e = false /\
    (forall x, In x (pattern_variables p) -> binds b x = true) /\ fits_pattern (values_of b) p (content e) /\
    (timed o = true -> binds b (clock t o) = true /\ values_of b (clock t o) = time_value e) /\
    (forall g, In g clocked_guards -> forall x, In x (variables g) ->
       In x (pattern_variables p) \/ (timed o = true /\ x = clock t o) -> passes b g = true)).
Proof.
  intros o e b I. destruct (required_atom o I) as (q & A & S). rewrite S. unfold scenario_atom in A.
  destruct (on (node_at t (fst o))) as [p |] eqn:P; [| discriminate]. injection A as <-.
  rewrite observes_iff. unfold atom_variables; simpl. split.
  - intros (L & V & F & T & G). exists p. split; auto. split; auto. split; [intros; apply V, in_app_iff; auto |].
    split; auto. split.
    + intros Q. rewrite Q in *. split; [apply V, in_app_iff; simpl; auto | auto].
    + intros g J x X H. apply G. apply filter_In; split; auto. apply existsb_exists. exists x; split; auto.
      apply Conditions.member_iff, in_app_iff. destruct H as [H | [Q ->]]; auto. rewrite Q. simpl; auto.
  - intros (p' & Q & L & V & F & T & G). injection Q as <-. split; auto. split; [| split; [auto | split]].
    + intros x X. apply in_app_iff in X as [X | X]; auto. destruct (timed o); [| destruct X].
      destruct X as [<- | []]. now apply T.
    + intros x Q. destruct (timed o); [| discriminate]. injection Q as <-. now apply T.
    + intros g J. apply filter_In in J as [J C]. apply existsb_exists in C as (x & X & M).
      apply Conditions.member_iff, in_app_iff in M. apply (G g J x X). destruct M as [M | M]; auto. right.
      destruct (timed o); [| destruct M]. destruct M as [<- | []]; auto.
Qed.

(** Clocks whose values are the times make a clocked guard what the guard is. *)
Lemma holds_clocked : forall a m g, NoDup (domain m) -> In g guards -> known t part m g = true ->
  (forall o e, In (o, e) m -> timed o = true -> a (clock t o) = time_value e) ->
  holds a no_time (clocked (clock t) part g) = holds a (time_at part m) g.
Proof.
  intros a m g N I K C. destruct (guard_timed g I) as [T P]. unfold holds.
    rewrite eval_clocked with (time := time_at part m);
    auto.
  intros p J. destruct (P p J) as [NE NE']. apply point_told; auto. intros o O. destruct (NE' o O) as [TI _].
  unfold known in K. apply andb_true_iff in K as [_ K]. rewrite forallb_forall in K. apply K in J.
  rewrite forallb_forall in J. apply J, among_iff, in_domain in O as (e & O).
  exists e; split; auto.
Qed.

(** ** From slices to the tree *)

Definition forget (m : assigned sliced) : assigned event := map (fun y => (fst y, fst (snd y))) m.

Lemma forget_domain : forall m, domain (forget m) = domain m.
Proof. intros m. unfold domain, forget. now rewrite map_map. Qed.

Lemma in_forget : forall m o e, In (o, e) (forget m) <-> exists b, In (o, (e, b)) m.
Proof.
  intros m o e. unfold forget. rewrite in_map_iff. split.
  - intros ([o' [e' b]] & Q & I). simpl in Q. injection Q as -> ->. eauto.
  - intros (b & I). exists (o, (e, b)); auto.
Qed.

(** Of some occurrences, the one that is served last. *)
Lemma latest_served : forall (position : occurrence -> nat) (test : occurrence -> bool) l o, In o l ->
  test o = true ->
  exists o', In o' l /\ test o' = true /\ forall p, In p l -> test p = true -> position p <= position o'.
Proof.
  intros position test; induction l as [| p l IH]; intros o I T; [destruct I |].
  destruct (existsb test l) eqn:X.
  - apply existsb_exists in X as (q & J & Q). destruct (IH q J Q) as (o' & K & T' & M).
    destruct (test p) eqn:P; [destruct (le_lt_dec (position p) (position o')) |].
    + exists o'; simpl; repeat split; auto. intros z [<- | Z] Tz; auto.
    + exists p; simpl; repeat split; auto. intros z [<- | Z] Tz; auto. specialize (M z Z Tz). lia.
    + exists o'; simpl; repeat split; auto. intros z [<- | Z] Tz; auto. congruence.
  - assert (N : forall z, In z l -> test z = true -> False).
    { intros z Z Tz. assert (existsb test l = true) by (apply existsb_exists; eauto). congruence. }
    exists o. split; auto. split; auto. intros z [<- | Z] Tz; [| exfalso; eauto].
    destruct I as [<- | I]; auto. exfalso; eauto.
Qed.

Lemma from_slice : forall p position m, Growing p -> Partial (denoted slice_plan) p position m ->
  Partial (denoted tree_plan) (map fst p) position (forget m).
Proof.
  intros p position m G P. assert (P' := P). destruct P' as [ON OF AT NT DC PK CH]. simpl in *.
  assert (SAT : forall o e b, In (o, (e, b)) m -> In o os /\ sat (required o) (e, b) = true).
  { intros o e b I. split; [apply OF, in_domain; eauto |]. rewrite forallb_forall in CH. apply (CH _ I). }
  constructor; rewrite ?forget_domain; simpl; auto.
  - intros o e I. apply in_forget in I as (b & I). apply AT in I. exact (map_nth_error fst _ _ I).
  - apply (consistent_under t guards part). exists (values_of (latest p)).
    assert (LAST : forall o e b x, In (o, (e, b)) m -> binds b x = true ->
      binds (latest p) x = true /\ values_of (latest p) x = values_of b x).
    { intros o e b x I B. apply AT in I. apply (latest_grows p _ _ G) in I. now apply grows_binds. }
    split.
    + intros o e I. apply in_forget in I as (b & I). destruct (SAT _ _ _ I) as [O S].
      apply sat_iff in S as (q & Q & L & V & F & _); auto. split; auto. exists q; split; [now rewrite pattern_at_basic |].
      apply fits_pattern_same with (values_of b); auto. intros x X. symmetry. eapply LAST; eauto.
    + intros g I K. destruct (is_constant g) eqn:C.
      { unfold constants_hold in constants. rewrite forallb_forall in constants.
        rewrite <- (constants g) by (apply filter_In; auto). unfold is_constant in C.
          apply andb_true_iff in C as [C D].
        apply is_nil_iff in C, D. apply holds_same; [rewrite C | rewrite D]; intros ? []. }
      set (g' := clocked (clock t) part g).
      assert (IG : In g' clocked_guards) by (apply in_scenario_guards; eauto).
      assert (TM : forall o e, In (o, e) (forget m) -> timed o = true -> values_of (latest p) (clock t o) =
        time_value e).
      { intros o e J T. apply in_forget in J as (b & J). destruct (SAT _ _ _ J) as [O S].
        apply sat_iff in S as (q & _ & _ & _ & _ & TV & _); auto. destruct (TV T) as [B <-]. eapply LAST; eauto. }
      rewrite <- (holds_clocked _ (forget m)); auto; [| now rewrite forget_domain].
      fold g'.
      (* each variable belongs to some occurrence that is served *)
      assert (OWN : forall x, In x (variables g') -> exists o q, In o (domain m) /\ on (node_at t (fst o)) = Some q /\
        (In x (pattern_variables q) \/ (timed o = true /\ x = clock t o))).
      { intros x X. apply clocked_variables in X as [X | (pt & o & J & A & ->)].
        - unfold known in K. apply andb_true_iff in K as [K _]. rewrite forallb_forall in K. apply K in X.
          apply Conditions.member_iff in X. unfold bound_variables in X. apply in_flat_map in X as (o & O & X).
          rewrite forget_domain in O. rewrite pattern_at_basic in X by auto. destruct (on (node_at t (fst o))) as [q |] eqn:Q; [| destruct X].
            exists o, q; auto.
        - unfold known in K. apply andb_true_iff in K as [_ K]. rewrite forallb_forall in K.
          assert (D := K pt J). rewrite forallb_forall in D. assert (A' := A). apply D, among_iff in A'.
            rewrite forget_domain in A'.
          assert (O := OF o A'). apply occurrences_iff in O as (_ & O & _).
          destruct (on (node_at t (fst o))) as [q |] eqn:Q; [| congruence]. exists o, q. split; auto. split; auto.
          right. split; auto. destruct (guard_timed g I) as [_ TI]. now apply (TI pt J). }
      set (touched := fun o => existsb (fun x => Conditions.member x (node_variables t (fst o)) ||
        (timed o && (x =? clock t o))) (variables g')).
      assert (TOUCH : forall o q x, on (node_at t (fst o)) = Some q -> In x (variables g') ->
        In x (pattern_variables q) \/ (timed o = true /\ x = clock t o) -> touched o = true).
      { intros o q x Q X H. apply existsb_exists. exists x; split; auto. apply orb_true_iff.
        destruct H as [H | [H ->]].
        - left. apply Conditions.member_iff. unfold node_variables. now rewrite Q.
        - right. now rewrite H, Nat.eqb_refl. }
      assert (NC : exists x, In x (variables g')).
      { destruct (variables g') as [| x l] eqn:V; [| exists x; simpl; auto]. exfalso.
        unfold is_constant in C. apply andb_false_iff in C as [C | C].
        - destruct (variables g) as [| x l] eqn:W; [discriminate |].
          assert (X : In x (variables g')) by (apply clocked_variables; rewrite W; simpl; auto). rewrite V in X.
            destruct X.
        - destruct (points g) as [| pt l] eqn:W; [discriminate |]. destruct (guard_timed g I) as [_ TI].
          destruct (TI pt) as [NE _]; [rewrite W; simpl; auto |].
          destruct (asked_by part pt) as [| o l'] eqn:A; [congruence |].
          assert (X : In (clock t o) (variables g')).
          { apply clocked_variables. right. exists pt, o. rewrite W, A. simpl; auto. }
          rewrite V in X. destruct X. }
      destruct NC as (x0 & X0). destruct (OWN x0 X0) as (o0 & q0 & O0 & Q0 & H0).
      destruct (latest_served position touched (domain m) o0 O0 (TOUCH o0 q0 x0 Q0 X0 H0)) as (o & O & T & M).
      apply in_domain in O as O'. destruct O' as ([e b] & O'). destruct (SAT _ _ _ O') as [IO S].
      apply sat_iff in S as (q & Q & _ & _ & _ & _ & GU); auto.
      assert (BD : forall x, In x (variables g') -> binds b x = true).
      { intros x X. destruct (OWN x X) as (o1 & q1 & O1 & Q1 & H1). assert (T1 := TOUCH o1 q1 x Q1 X H1).
        specialize (M o1 O1 T1). apply in_domain in O1 as ([e1 b1] & O1). destruct (SAT _ _ _ O1) as [IO1 S1].
        apply sat_iff in S1 as (q1' & Q1' & _ & V1 & _ & TV1 & _); auto. rewrite Q1 in Q1'. injection Q1' as <-.
        assert (B1 : binds b1 x = true) by (destruct H1 as [H1 | [H1 ->]]; [auto | now apply TV1]).
        apply (grows_binds b1 b x); auto. apply (G _ _ (e1, b1) (e, b) M); auto. }
      apply existsb_exists in T as (x & X & T).
      assert (PA : passes b g' = true).
      { apply (GU g' IG x X). apply orb_true_iff in T as [T | T].
        - left. apply Conditions.member_iff in T. unfold node_variables in T. now rewrite Q in T.
        - right. apply andb_true_iff in T as [T T']. now apply Nat.eqb_eq in T'. }
      unfold passes in PA. apply orb_true_iff in PA as [PA | PA].
      * apply negb_true_iff in PA. rewrite <- not_true_iff_false in PA. exfalso. apply PA. apply forallb_forall. auto.
      * rewrite <- PA. apply holds_same; [| unfold g'; rewrite clocked_points; intros ? []].
        intros y Y. eapply LAST; eauto.
Qed.

(** ** From the tree to slices *)

Section Serving.
Variable u : list event.
Variable position : occurrence -> nat.
Variable m : assigned event.
Variable a : nat -> value.
Hypothesis partial : Partial (denoted tree_plan) u position m.
Hypothesis under_a : Under t guards part a m.

(** Values of all variables: for those of clocks the times. *)
Definition value_at (x : nat) : value :=
  match find (fun y => x =? clock t (fst y)) m with Some y => time_value (snd y) | None => a x end.

Definition owns (o : occurrence) (x : nat) : bool :=
  Conditions.member x (node_variables t (fst o)) || (timed o && (x =? clock t o)).

(** The assignment before position [i]: the variables of the occurrences that are served. *)
Definition served_before (i : nat) : assignment := fun x =>
  if existsb (fun o => (position o <? i) && owns o x) (domain m) then Some (value_at x) else None.

Lemma owns_iff : forall o x p, on (node_at t (fst o)) = Some p ->
  (owns o x = true <-> In x (pattern_variables p) \/ (timed o = true /\ x = clock t o)).
Proof.
  intros o x p P. unfold owns, node_variables. rewrite P, orb_true_iff, andb_true_iff, Conditions.member_iff,
    Nat.eqb_eq.
  tauto.
Qed.

Lemma served_os : forall o, In o (domain m) -> In o os.
Proof. apply (of_scenario _ _ _ _ partial). Qed.

Lemma served_pattern : forall o, In o (domain m) -> exists p, on (node_at t (fst o)) = Some p.
Proof.
  intros o I. apply served_os, occurrences_iff in I as (_ & O & _).
  destruct (on (node_at t (fst o))); [eauto | congruence].
Qed.

Lemma value_clock : forall o e, In (o, e) m -> value_at (clock t o) = time_value e.
Proof.
  intros o e I. unfold value_at. destruct (find _ m) as [[o' e'] |] eqn:F.
  - apply find_some in F as [J Q]. apply Nat.eqb_eq in Q. apply clock_one in Q; cbn [fst] in *.
    + cbn [fst snd] in *. subst o'. assert (N := once _ _ _ _ partial).
      apply (seen_iff _ m o e N) in I. apply (seen_iff _ m o e' N) in J. congruence.
    + apply occurrence_bound, served_os, in_domain; eauto.
    + apply occurrence_bound, served_os, in_domain; eauto.
  - apply (find_none _ _ F) in I. cbn [fst] in I. now rewrite Nat.eqb_refl in I.
Qed.

Lemma value_variable : forall x, (forall o, x <> clock t o) -> value_at x = a x.
Proof.
  intros x N. unfold value_at. destruct (find _ m) as [[o e] |] eqn:F; auto.
  apply find_some in F as [_ Q]. apply Nat.eqb_eq in Q. exfalso. eapply N, Q.
Qed.

Lemma served_binds : forall i x, binds (served_before i) x = true <->
  exists o, In o (domain m) /\ position o < i /\ owns o x = true.
Proof.
  intros i x. unfold binds, served_before. destruct (existsb _ (domain m)) eqn:X.
  - split; auto. intros _. apply existsb_exists in X as (o & I & H). apply andb_true_iff in H as [L H].
    apply Nat.ltb_lt in L. eauto.
  - split; [discriminate |]. intros (o & I & L & H).
    assert (existsb (fun o => (position o <? i) && owns o x) (domain m) = true); [| congruence].
    apply existsb_exists. exists o; split; auto. apply andb_true_iff; split; auto. now apply Nat.ltb_lt.
Qed.

Lemma served_value : forall i x, binds (served_before i) x = true -> values_of (served_before i) x = value_at x.
Proof.
  intros i x B. unfold binds, values_of, served_before in *. destruct (existsb _ (domain m)); [auto | discriminate].
Qed.

(** A guard holds once all its variables are bound. *)
Lemma served_passes : forall i g, In g clocked_guards -> passes (served_before i) g = true.
Proof.
  intros i g' I. apply in_scenario_guards in I as (g & I & _ & ->). unfold passes. apply orb_true_iff.
  destruct (forallb (binds (served_before i)) (variables (clocked (clock t) part g))) eqn:B; [right | auto].
  rewrite forallb_forall in B.
  assert (K : known t part m g = true).
  { unfold known. apply andb_true_iff; split; apply forallb_forall.
    - intros x X. apply Conditions.member_iff. assert (Y : In x (variables (clocked (clock t) part g)))
        by (apply clocked_variables; auto).
      apply B, served_binds in Y as (o & O & _ & W). destruct (served_pattern o O) as (p & P).
      apply (owns_iff o x p P) in W. destruct W as [W | [_ W]]; [| exfalso; eapply guard_no_clock; eauto].
      unfold bound_variables. apply in_flat_map. exists o; split; auto. now rewrite pattern_at_basic, P.
    - intros pt J. apply forallb_forall. intros o A. apply among_iff.
      assert (Y : In (clock t o) (variables (clocked (clock t) part g))) by (apply clocked_variables; eauto 6).
      apply B, served_binds in Y as (o' & O & _ & W). destruct (served_pattern o' O) as (p & P).
      apply (owns_iff o' _ p P) in W. destruct W as [W | [_ W]].
      + exfalso. eapply pattern_no_clock; [| exact P | exact W | reflexivity]. now apply served_os.
      + apply clock_one in W; [now subst | | now apply occurrence_bound, served_os].
        destruct (guard_timed g I) as [_ TI]. now apply (TI pt J). }
  rewrite (holds_same _ value_at _ no_time); [| intros x X; now apply served_value, B
    | rewrite clocked_points; intros ? []].
  rewrite (holds_clocked value_at m); auto; [| apply (once _ _ _ _ partial) | intros; now apply value_clock].
  rewrite (holds_same _ a _ (time_at part m)); auto; [now apply under_a |].
  intros x X. apply value_variable. intros c. now apply (guard_no_clock g x c).
Qed.

(** The event that serves an occurrence satisfies its test. *)
Lemma served_sat : forall o e, In (o, e) m -> sat (required o) (e, served_before (S (position o))) = true.
Proof.
  intros o e I. assert (D : In o (domain m)) by (apply in_domain; eauto). assert (O := served_os o D).
  destruct (proj1 under_a o e I) as (L & p & P & F). rewrite pattern_at_basic in P by auto. apply sat_iff; auto. exists p.
  assert (BD : forall x, owns o x = true -> binds (served_before (S (position o))) x = true).
  { intros x X. apply served_binds. exists o. repeat split; auto. }
  split; [auto | split; [auto |]]. split; [| split; [| split]].
  - intros x X. apply BD, (owns_iff o x p P). auto.
  - apply fits_pattern_same with a; auto. intros x X. rewrite served_value by (apply BD, (owns_iff o x p P); auto).
    symmetry. apply value_variable. intros c. now apply (pattern_no_clock o p x c).
  - intros T. assert (B : binds (served_before (S (position o))) (clock t o) = true)
      by (apply BD, (owns_iff o _ p P); auto).
    split; auto. rewrite served_value by exact B. now apply value_clock.
  - intros g G x X _. now apply served_passes.
Qed.

Lemma served_grows : forall i j, i <= j -> grows (served_before i) (served_before j).
Proof.
  intros i j L x v Q. assert (B : binds (served_before i) x = true) by (unfold binds; now rewrite Q).
  assert (C : binds (served_before j) x = true).
  { apply served_binds in B as (o & I & P & W). apply served_binds. exists o. repeat split; auto. lia. }
  assert (V := served_value i x B). assert (V' := served_value j x C). unfold values_of in V, V'. rewrite Q in V.
  unfold binds in C. destruct (served_before j x); congruence.
Qed.

(** Some atom of the text has the pattern of each occurrence with variables, and no more guards. *)
Variable atoms : list atom.
Hypothesis atoms_of_scenario : forall o q, In o os -> atom_of o = Some q -> atom_variables q = [] \/
  exists q', In q' atoms /\ atom_pattern q' = atom_pattern q /\ atom_time q' = atom_time q /\
    incl (atom_guards q') (atom_guards q).

Lemma served_steps : forall i e, nth_error u i = Some e -> Binds atoms e (served_before i) (served_before (S i)).
Proof.
  intros i e N. destruct (existsb (fun o => position o =? i) (domain m)) eqn:X.
  - apply existsb_exists in X as (o & D & Q). apply Nat.eqb_eq in Q. apply in_domain in D as D'.
    destruct D' as (f & I).
    assert (f = e) by (apply (at_positions _ _ _ _ partial) in I; congruence). subst f.
    assert (O := served_os o D). assert (S := served_sat o e I). rewrite Q in S.
    destruct (required_atom o O) as (q & A & SA). rewrite SA in S.
    assert (SAME : forall x, ~ In x (atom_variables q) -> served_before (Datatypes.S i) x = served_before i x).
    { intros x NX. unfold served_before.
      assert (E : existsb (fun o => (position o <? Datatypes.S i) && owns o x) (domain m) =
                  existsb (fun o => (position o <? i) && owns o x) (domain m)); [| now rewrite E].
      apply existsb_ext_in. intros o' D'. destruct (owns o' x) eqn:W; [| now rewrite !andb_false_r].
        rewrite !andb_true_r.
      apply eq_true_iff_eq. rewrite !Nat.ltb_lt. split; [| lia]. intros LT.
      enough (position o' <> i) by lia. intros Q'. assert (o' = o).
      { apply (no_position_twice _ _ _ _ partial); auto. congruence. }
      subst o'. apply NX. destruct (served_pattern o D) as (p & P). apply (owns_iff o x p P) in W.
      unfold scenario_atom in A. rewrite P in A. injection A as <-. unfold atom_variables; simpl.
      apply in_app_iff. destruct W as [W | [W ->]]; auto. rewrite W. simpl; auto. }
    destruct (atoms_of_scenario o q O A) as [NV | (q' & J & QP & QT & QG)].
    { apply keeps. intros x. apply SAME. rewrite NV. intros []. }
    apply extends with q'; auto.
    + apply observes_iff in S as (L & V & F & T & G). apply observes_iff. unfold atom_variables in *.
      rewrite QP, QT. repeat split; auto.
    + apply served_grows; lia.
    + intros x NX. apply SAME. unfold atom_variables in *. now rewrite <- QP, <- QT.
  - apply keeps. intros x. unfold served_before.
    assert (E : existsb (fun o => (position o <? S i) && owns o x) (domain m) =
                existsb (fun o => (position o <? i) && owns o x) (domain m)); [| now rewrite E].
    apply existsb_ext_in. intros o D. f_equal. apply eq_true_iff_eq. rewrite !Nat.ltb_lt. split; [| lia]. intros LT.
    enough (position o <> i) by lia. intros Q. rewrite <- not_true_iff_false in X. apply X. apply existsb_exists.
    exists o; split; auto. now apply Nat.eqb_eq.
Qed.

Lemma served_slice : Slice atoms u (under (fun i => served_before (S i)) 0 u).
Proof.
  apply slice_under; [| apply served_steps]. intros x. unfold served_before.
  replace (existsb _ (domain m)) with false; auto. symmetry. apply not_true_is_false. intros X.
  apply existsb_exists in X as (o & _ & X). apply andb_true_iff in X as [X _]. apply Nat.ltb_lt in X. lia.
Qed.
End Serving.

Definition recall (b : nat -> assignment) (position : occurrence -> nat) (m : assigned event) : assigned sliced :=
  map (fun y => (fst y, (snd y, b (position (fst y))))) m.

Lemma recall_domain : forall b position m, domain (recall b position m) = domain m.
Proof. intros b position m. unfold domain, recall. now rewrite map_map. Qed.

Lemma to_slice : forall atoms u position m,
  (forall o q, In o os -> atom_of o = Some q -> atom_variables q = [] \/ exists q', In q' atoms /\
     atom_pattern q' = atom_pattern q /\ atom_time q' = atom_time q /\ incl (atom_guards q') (atom_guards q)) ->
  Partial (denoted tree_plan) u position m ->
  exists p m', Slice atoms u p /\ domain m' = domain m /\ Partial (denoted slice_plan) p position m'.
Proof.
  intros atoms u position m A P. assert (C := conditions_hold _ _ _ _ P). simpl in C.
  apply (consistent_under t guards part) in C as (a & C).
  set (b := fun i => served_before position m a (S i)).
  exists (under b 0 u), (recall b position m).
  split; [now apply served_slice |]. split; [apply recall_domain |].
  assert (P' := P). destruct P' as [ON OF AT NT DC PK CH]. simpl in *.
  constructor; rewrite ?recall_domain; simpl; auto.
  - intros o y I. apply in_map_iff in I as ([o' e] & Q & I). injection Q as <- <-. rewrite nth_under. simpl.
    now rewrite (AT _ _ I).
  - apply forallb_forall. intros y I. apply in_map_iff in I as ([o e] & <- & I). simpl.
    apply (served_sat u position m a P C o e I).
Qed.
End Scenario.
