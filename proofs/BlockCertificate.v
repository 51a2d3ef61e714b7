(** * Certifying texts of RML with variables

    A text whose block is outermost is compared with the scenarios of the tree over the letters of
    [SlicedLetters.v].  A state of the text has the variables that have a value.  The letters of a state are
    those of an assignment of these variables that the event completes, and a state is good when the
    assignment is fair to all partial matches ([Determined.v]).  [certify_block_correct]: a certified text has
    the verdict of the tree on every trace of JSON values without late events. *)

Require Import List Bool Arith ZArith Lia.
Require Import RVAFT.Values RVAFT.Language RVAFT.Definition RVAFT.Search RVAFT.Conditions RVAFT.Scenarios.
Require Import RVAFT.Monitor RVAFT.Verdicts RVAFT.Plain RVAFT.Automaton RVAFT.Exploration RVAFT.Letters.
Require Import RVAFT.PlainTree RVAFT.Relevance RVAFT.Rml RVAFT.RmlCertificate RVAFT.Slices RVAFT.SlicedTree.
Require Import RVAFT.SlicedCertificate RVAFT.SlicedLetters RVAFT.SlicedValidator.
Require Import RVAFT.Determined RVAFT.RmlVariables RVAFT.Equalities.
Import ListNotations.

(** ** JSON values *)

Lemma value_along_defined : forall l v w, value_along l v = Some w -> defined v = true -> defined w = true.
Proof.
  induction l as [| f l IH]; intros v w V D; [injection V as <-; auto |]. simpl in V.
  destruct v as [| | | | | object |]; try discriminate. destruct (field f object) as [u |] eqn:F; [| discriminate].
  apply (IH u w V). simpl in D. clear V. induction object as [| [g z] object IHo]; [discriminate |].
  simpl in F, D. apply andb_true_iff in D as [D D']. destruct (text_eqb f g); [congruence | auto].
Qed.

(** An event of JSON values that is not late. *)
Definition json_event (e : event) : Prop := late e = false /\ defined (content e) = true.

Definition all_defined_values (b : assignment) : Prop := forall x v, b x = Some v -> defined v = true.

Lemma completed_defined : forall ps hidden b e, determined ps = true -> json_event e -> all_defined_values b ->
  all_defined_values (completed ps hidden b e).
Proof.
  intros ps hidden b e D [_ J] B x v Q. unfold completed in Q. destruct (b x) eqn:X; [injection Q as <-; eauto |].
  destruct (Conditions.member x hidden); [discriminate |].
  apply found_some in Q as (p & a & I & M & F & <-). destruct F as (c & A & F).
  unfold determined in D. rewrite forallb_forall in D. specialize (D p I). rewrite forallb_forall in D.
  specialize (D p I). rewrite forallb_forall in D. assert (M' := proj1 (Conditions.member_iff _ _) M).
  specialize (D x M'). rewrite M in D. simpl in D. apply orb_true_iff in D as [D | D].
  - exfalso. eapply exclude_sound; eauto.
  - destruct (path x p) as [l |] eqn:P; [| discriminate]. apply (path_value x c p _ l P) in F.
    rewrite <- A. eapply value_along_defined; eauto.
Qed.

(** ** The letters of an assignment that an event completes *)

Section Letters.
Variable t : tree.
Variable ps : list predicate.
Variables basic composed : list atom.

Notation qs := (basic ++ composed).
Notation sat := (slice_satisfies t ps qs).
Notation patterns := (map atom_pattern qs).
Notation number := (atom_number ps qs).

Definition is_pattern (q : atom) : bool :=
  placed basic q && is_nil (atom_guards q) && match atom_time q with None => true | Some _ => false end.

(** The variables of a pattern, its number, and that of the event that fits it under any assignment. *)
Definition pattern_table : list (list nat * (option nat * option nat)) :=
  map (fun q => (pattern_variables (atom_pattern q), (if is_pattern q then Some (number q) else None,
      let bare : predicate := (atom_pattern q, []) in
      if listed ps bare then Some (number_in ps bare) else None))) qs.

(** Where a variable has its place, the numbers of a pattern and of that with another operand in this place. *)
Definition equality_table : list (nat * operand * (nat * nat)) :=
  let pairs := flat_map (fun q => flat_map equalities (atom_guards q)) basic in
  flat_map (fun xo : nat * operand => let '(x, o) := xo in
    flat_map (fun q =>
      match path x (atom_pattern q) with
      | Some _ =>
        if is_pattern q then
          match o with
          | Literal v => if defined v then map (fun r => (x, o, (number q, number_in ps r)))
              (filter (fun r => listed ps r && bare_as r (focus x o (atom_pattern q))) ps) else []
          | Another y => map (fun r => (x, o, (number q, number r)))
              (filter (fun r => is_pattern r && same_pattern (atom_pattern r) (focus x o (atom_pattern q))) basic)
          end
        else []
      | None => []
      end) basic) pairs.

Definition same_operand (o o' : operand) : bool :=
  match o, o' with
  | Literal v, Literal w => value_eqb v w
  | Another x, Another y => Nat.eqb x y
  | Literal _, Another _ | Another _, Literal _ => false
  end.

Lemma same_operand_eq : forall o o', same_operand o o' = true -> o = o'.
Proof. intros [v | x] [w | y] E; try discriminate; f_equal; [now apply value_eqb_iff | now apply Nat.eqb_eq]. Qed.

(** A predicate of its own with a pattern of some atom: the variables, its number and those of its guards. *)
Definition own_table : list (list nat * (nat * list nat)) :=
  flat_map (fun r : nat * (list nat * list nat) =>
    let p := fst (nth (fst r - 1) ps (Anything, [])) in
    if existsb (fun q => same_pattern (atom_pattern q) p) qs then [(pattern_variables p, (fst r, snd (snd r)))] else [])
    (consequences ps basic composed).

Section Possible.
Variable table : list (list nat * (option nat * option nat)).
Variable equal : list (nat * operand * (nat * nat)).
Variable asked : list (nat * guard).          (* the guards with their numbers *)
Variable own : list (list nat * (nat * list nat)).
Variables bound hidden : list nat.
Variable a : letter.

(** Whether the event gives a value to a variable, or may give one. *)
Definition has_value (x : nat) : bool :=
  Conditions.member x bound || existsb (fun r => Conditions.member x (fst r) &&
    match fst (snd r) with Some n => Automaton.member n a | None => false end) table.
Definition may_have_value (x : nat) : bool :=
  Conditions.member x bound || (negb (Conditions.member x hidden) && existsb (fun r => Conditions.member x (fst r) &&
    match snd (snd r) with Some k => Automaton.member k a | None => true end) table).
Definition known_or_hidden (xs : list nat) : bool :=
  existsb (fun x => Conditions.member x bound || Conditions.member x hidden) xs.

Definition equal_in (x : nat) (o : operand) : option bool :=
  if match o with Literal _ => true | Another y => has_value y end then
    match find (fun r => Nat.eqb (fst (fst r)) x && same_operand (snd (fst r)) o && Automaton.member (fst (snd r)) a) equal
      with Some r => Some (Automaton.member (snd (snd r)) a) | None => None end
  else None.

(** A guard that does not hold has all its values, and one that is decided holds as it is decided.  A pattern
    without known variables is observed when an event fits it, and the guards hold that a predicate of its own has. *)
Definition possible_in : bool :=
  forallb (fun ng => let '(n, g) := ng in
    (Automaton.member n a || forallb may_have_value (variables g)) &&
    (negb (forallb has_value (variables g)) ||
     match decide equal_in g with Some b => Bool.eqb b (Automaton.member n a) | None => true end)) asked &&
  forallb (fun r => match snd r with
    | (Some n, Some k) =>
      negb (Automaton.member k a) || known_or_hidden (fst r) || Automaton.member n a
    | _ => true
    end) table &&
  forallb (fun r => negb (Automaton.member (fst (snd r)) a) || known_or_hidden (fst r) ||
    forallb (fun n => Automaton.member n a) (snd (snd r))) own.
End Possible.

Definition asked_guards : list (nat * guard) :=
  flat_map (fun q => match atom_guards q with
    | [g] => if placed basic q && same_atom q (guard_atom g) then [(number q, g)] else []
    | _ => []
    end) basic.

Definition possible : list nat -> list nat -> letter -> bool :=
  let table := pattern_table in let equal := equality_table in let asked := asked_guards in
  let own := own_table in
  fun bound hidden a => possible_in table equal asked own bound hidden a.

(** *** The letter of a completed assignment is possible *)

Section Sound.
Hypothesis patterns_determined : determined patterns = true.
Variable b : assignment.
Variable e : event.
Variables bound hidden : list nat.
Hypothesis bound_iff : forall x, binds b x = Conditions.member x bound.
Hypothesis json : json_event e.
Hypothesis values_defined : all_defined_values b.

Notation b' := (completed patterns hidden b e).
Notation a := (letter_of sat (all_numbers ps basic composed) (e, b')).

Lemma number_member : forall q, placed basic q = true -> Automaton.member (number q) a = observes q (e, b').
Proof.
  intros q P. destruct (basic_number ps basic composed q P) as [I L]. rewrite member_letter.
  - now apply atom_satisfied.
  - unfold all_numbers. rewrite !in_app_iff. auto.
Qed.

Lemma closed_member : forall r, listed ps r = true -> Automaton.member (number_in ps r) a = meets r e.
Proof.
  intros r L. assert (K := L). apply Nat.ltb_lt in K. rewrite member_letter.
  - unfold slice_satisfies. replace (number_in ps r <=? length ps) with true
      by (symmetry; apply Nat.leb_le; unfold number_in; lia). now apply listed_numbered.
  - unfold all_numbers, closed_numbers. rewrite !in_app_iff. left. apply in_seq. unfold number_in. lia.
Qed.

Lemma bare_meets : forall p, meets (p, []) e = negb (is_nil (bindings p (content e))).
Proof.
  intros p. unfold meets. destruct json as [-> _]. simpl. destruct (bindings p (content e)); auto.
Qed.

Lemma is_pattern_iff : forall q, is_pattern q = true -> placed basic q = true /\ atom_variables q = pattern_variables
  (atom_pattern q) /\ (observes q (e, b') = true <->
    (forall x, In x (pattern_variables (atom_pattern q)) -> binds b' x = true) /\
    fits_pattern (values_of b') (atom_pattern q) (content e)).
Proof.
  intros q I. unfold is_pattern in I. rewrite !andb_true_iff in I. destruct I as [[P G] T].
  apply is_nil_iff in G. destruct (atom_time q) eqn:AT; [discriminate |].
  assert (V : atom_variables q = pattern_variables (atom_pattern q))
    by (unfold atom_variables; rewrite AT; apply app_nil_r).
  split; [auto | split; [auto |]]. rewrite observes_iff, V, AT, G. destruct json as [L _].
  split; [tauto |]. intros [B F].
  split; [exact L | split; [exact B | split; [exact F | split; [discriminate | intros g []]]]].
Qed.

Lemma has_value_sound : forall x, has_value pattern_table bound a x = true -> binds b' x = true.
Proof.
  intros x H. unfold has_value in H. rewrite <- bound_iff in H. apply orb_true_iff in H as [H | H].
  - unfold binds, completed in *. now destruct (b x).
  - apply existsb_exists in H as (r & I & H). apply andb_true_iff in H as [X M].
    apply in_map_iff in I as (q & <- & _). cbn [fst snd] in *. destruct (is_pattern q) eqn:P; [| discriminate].
    destruct (is_pattern_iff q P) as (PL & _ & O). rewrite number_member in M by exact PL.
    apply O in M as [B _]. apply B. now apply Conditions.member_iff.
Qed.

Lemma may_have_value_sound : forall x, binds b' x = true -> may_have_value pattern_table bound hidden a x = true.
Proof.
  intros x B. unfold may_have_value. rewrite <- bound_iff. unfold binds, completed in *.
  destruct (b x); auto. destruct (Conditions.member x hidden); [discriminate |].
  destruct (found patterns (content e) x) as [v |] eqn:F; [| discriminate]. simpl.
  apply found_some in F as (p & c & I & M & F & _). apply in_map_iff in I as (q & <- & I).
  apply existsb_exists. eexists. split; [apply in_map, I |]. cbn [fst snd]. unfold mentions in M. rewrite M. simpl.
  destruct (listed ps (atom_pattern q, [])) eqn:L; auto. rewrite closed_member, bare_meets by exact L.
  apply bindings_iff in F as (bs & J & _). now destruct (bindings (atom_pattern q) (content e)).
Qed.
Lemma equality_in : forall x o n k, In (x, o, (n, k)) (equality_table) -> exists q l, In q basic /\
  path x (atom_pattern q) = Some l /\ is_pattern q = true /\ n = number q /\
  match o with
  | Literal v => defined v = true /\ exists r, listed ps r = true /\ k = number_in ps r /\
      bare_as r (focus x o (atom_pattern q)) = true
  | Another y => exists r, is_pattern r = true /\ k = number r /\ atom_pattern r = focus x o (atom_pattern q)
  end.
Proof.
  intros x o n k I. unfold equality_table in I. cbv zeta in I. apply in_flat_map in I as ([x' o'] & _ & I).
  apply in_flat_map in I as (q & Q & I). destruct (path x' (atom_pattern q)) as [l |] eqn:P; [| destruct I].
  destruct (is_pattern q) eqn:IP; [| destruct I]. exists q, l. destruct o' as [v | y].
  - destruct (defined v) eqn:D; [| destruct I]. apply in_map_iff in I as (r & E & I). injection E as <- <- <- <-.
    apply filter_In in I as [_ I]. apply andb_true_iff in I as [L B]. repeat split; auto. exists r; auto.
  - apply in_map_iff in I as (r & E & I). injection E as <- <- <- <-. apply filter_In in I as [_ I].
    apply andb_true_iff in I as [L B]. apply same_pattern_eq in B. repeat split; auto. exists r; auto.
Qed.

Lemma equal_in_sound : forall x o v, equal_in pattern_table equality_table bound a x o = Some v ->
  defined (values_of b' x) = true /\ defined (operand_value (values_of b') o) = true /\
  v = value_eqb (values_of b' x) (operand_value (values_of b') o).
Proof.
  intros x o v E. unfold equal_in in E.
  destruct (match o with Literal _ => true | Another y => has_value pattern_table bound a y end) eqn:HV;
    [| discriminate].
  destruct (find _ equality_table) as [[[x' o'] [n k]] |] eqn:F; [| discriminate]. injection E as <-.
  apply find_some in F as [I F]. cbn [fst snd] in *. rewrite !andb_true_iff in F. destruct F as [[X O] N].
  apply Nat.eqb_eq in X. apply same_operand_eq in O. subst x' o'.
  apply equality_in in I as (q & l & Q & P & IP & -> & K).
  destruct (is_pattern_iff q IP) as (PL & _ & OB). rewrite number_member in N by exact PL. apply OB in N as [B FT].
  assert (DEF : forall z, binds b' z = true -> defined (values_of b' z) = true).
  { intros z Z. unfold binds, values_of in *. destruct (b' z) as [w |] eqn:W; [| discriminate].
    now apply (completed_defined patterns hidden b e patterns_determined json values_defined z). }
  assert (XV : In x (pattern_variables (atom_pattern q))).
  { clear - P. revert l P. induction (atom_pattern q) as [w | y | | fields IH | items IH | p IH] using pattern_induction;
      intros l P; try discriminate.
    - destruct y as [y | y]; [| discriminate]. simpl in *. destruct (Nat.eqb_spec x y); [auto | discriminate].
    - cbn [path pattern_variables] in *. revert l P. induction IH as [| [f p] fields H _ IHF]; intros l P;
        [discriminate |]. cbn [flat_map snd]. apply in_app_iff. destruct (path x p) eqn:R; [left; eapply H; eauto |].
      right. eapply IHF; eauto. }
  split; [now apply DEF, B |]. assert (FF := focus_fits x o _ l (values_of b') (values_of b') _ P FT).
  destruct o as [w | y].
  - destruct K as (D & r & L & -> & BA). split; auto. apply eq_true_iff_eq. rewrite value_eqb_iff, closed_member by exact L.
    destruct json as [LA _]. rewrite (bare_as_meets r _ e BA LA). rewrite <- FF. split.
    + intros M. exists (fun z => match z with Rigid z => values_of b' z | Language.Local _ => Null end). auto.
    + intros E c. destruct FT as (c0 & A0 & M0). apply focus_matches with c0; auto. rewrite A0. now apply FF.
  - destruct K as (r & IR & -> & R). apply has_value_sound in HV. split; [now apply DEF |].
    destruct (is_pattern_iff r IR) as (PR & _ & OR). apply eq_true_iff_eq.
    rewrite value_eqb_iff, number_member by exact PR. rewrite OR, R, <- FF. split; [tauto |]. intros E; split; auto.
    intros z Z. apply focus_variables in Z. now injection Z as <-.
Qed.

Lemma asked_guard : forall n g, In (n, g) asked_guards -> Automaton.member n a = passes b' g.
Proof.
  intros n g I. unfold asked_guards in I. apply in_flat_map in I as (q & _ & I).
  destruct (atom_guards q) as [| g' [|]]; try destruct I. destruct (placed basic q && _) eqn:H; [| destruct I].
  destruct I as [I | []]. injection I as <- <-. apply andb_true_iff in H as [P S]. apply same_atom_eq in S.
  rewrite number_member by exact P. rewrite S, observes_guard. now destruct json as [-> _].
Qed.

(** The values of an event for the variables of a pattern none of which is known. *)
Lemma all_new : forall p bs, In p patterns -> In bs (bindings p (content e)) ->
  known_or_hidden bound hidden (pattern_variables p) = false ->
  forall x, In x (pattern_variables p) -> b' x = Some (get Nat.eqb bs x).
Proof.
  intros p bs I J X x Y. unfold completed.
  assert (N : Conditions.member x bound || Conditions.member x hidden = false).
  { apply not_true_iff_false. intros M. rewrite <- not_true_iff_false in X. apply X. apply existsb_exists. eauto. }
  apply orb_false_iff in N as [N H]. rewrite <- bound_iff in N. unfold binds in N. destruct (b x); [discriminate |].
  rewrite H.
  apply found_fits with p; auto; [now apply Conditions.member_iff |].
  apply bindings_iff. exists bs; split; auto. now apply (bindings_agree p (content e)).
Qed.

Lemma own_sound : forall r, In r own_table -> Automaton.member (fst (snd r)) a = true ->
  known_or_hidden bound hidden (fst r) = false ->
  forallb (fun n => Automaton.member n a) (snd (snd r)) = true.
Proof.
  intros r I M X. unfold own_table in I. apply in_flat_map in I as ([k [ms ns]] & I & J). cbv zeta in J.
  cbn [fst snd] in J. unfold consequences in I. apply in_flat_map in I as ([k' [p gs]] & C & I).
  apply (combine_seq _ _ (Anything, [])) in C as [C N].
  destruct (forallb _ gs) eqn:F; [| destruct I]. destruct I as [I | []]. injection I as <- <- <-.
  set (p' := fst (nth (k' - 1) ps (Anything, []))) in J. assert (PN : p = p') by exact (f_equal fst N).
  rewrite <- PN in J. clear p' PN. destruct (existsb _ qs) eqn:E; [| destruct J]. destruct J as [<- | []].
  cbn [fst snd] in *. apply existsb_exists in E as (q & Q & E). apply same_pattern_eq in E.
  assert (K : k' <= length ps) by (apply Nat.lt_succ_r; exact (proj2 C)).
  assert (P : In p patterns) by (rewrite <- E; now apply in_map).
  assert (ME : meets (p, gs) e = true).
  { rewrite member_letter in M by (unfold all_numbers, closed_numbers; rewrite in_app_iff, in_seq; left; lia).
    unfold slice_satisfies in M. replace (k' <=? length ps) with true in M by (symmetry; apply Nat.leb_le; lia).
    assert (NTH : nth_error ps (k' - 1) = Some (p, gs)) by (rewrite N; apply nth_error_nth'; lia).
    destruct k' as [| i]; [lia |]. simpl in M, NTH. rewrite Nat.sub_0_r in NTH. now rewrite NTH in M. }
  unfold meets in ME. cbn [fst snd] in ME. apply andb_true_iff in ME as [_ ME].
  apply existsb_exists in ME as (bs & B & H). rewrite forallb_forall in F, H.
  rewrite forallb_map. apply forallb_forall. intros g G. specialize (F g G). rewrite !andb_true_iff in F.
  destruct F as [[PT PG] VG]. apply is_nil_iff in PT. rewrite forallb_forall in VG.
  rewrite number_member by exact PG. rewrite observes_guard. destruct json as [-> _]. simpl. unfold passes.
  apply orb_true_iff. right. rewrite <- (H g G). apply holds_same; [| rewrite PT; intros ? []].
  intros x Y. apply VG, Conditions.member_iff in Y. unfold values_of. now rewrite (all_new p bs P B X x Y).
Qed.

Lemma possible_sound : possible bound hidden a = true.
Proof.
  unfold possible, possible_in. rewrite !andb_true_iff. split; [split |]; apply forallb_forall.
  - intros [n g] I. rewrite (asked_guard n g I). apply andb_true_iff; split.
    + destruct (passes b' g) eqn:P; auto. unfold passes in P. apply orb_false_iff in P as [P _].
      apply negb_false_iff in P. rewrite forallb_forall in P. apply forallb_forall. intros x X.
      now apply may_have_value_sound, P.
    + destruct (forallb _ (variables g)) eqn:H; auto. simpl. destruct (decide _ g) as [v |] eqn:D; auto.
      apply (decide_sound _ (values_of b') equal_in_sound) in D. unfold passes, Language.holds. rewrite D.
      rewrite forallb_forall in H. replace (forallb (binds b') (variables g)) with true
        by (symmetry; apply forallb_forall; intros x X; now apply has_value_sound, H).
      destruct v; reflexivity.
  - intros r I. apply in_map_iff in I as (q & <- & I). cbn [fst snd].
    destruct (is_pattern q) eqn:P; auto. destruct (listed ps _) eqn:L; auto.
    destruct (is_pattern_iff q P) as (PL & _ & O). rewrite closed_member, bare_meets, number_member by assumption.
    destruct (bindings (atom_pattern q) (content e)) as [| bs l] eqn:B; auto. simpl.
    destruct (known_or_hidden _ _ (pattern_variables _)) eqn:X; auto. simpl. apply O.
    assert (J : In bs (bindings (atom_pattern q) (content e))) by (rewrite B; simpl; auto).
    assert (F : fits_pattern (get Nat.eqb bs) (atom_pattern q) (content e)).
    { apply bindings_iff. exists bs; split; auto. now apply (bindings_agree (atom_pattern q) (content e)). }
    assert (V := all_new _ bs (in_map atom_pattern _ _ I) J X).
    split; [intros x Y; unfold binds; now rewrite (V x Y) |]. apply fits_pattern_same with (get Nat.eqb bs); auto.
    intros x Y. unfold values_of. now rewrite (V x Y).
  - intros r I. destruct (Automaton.member (fst (snd r)) a) eqn:M; auto. simpl.
    destruct (known_or_hidden _ _ (fst r)) eqn:X; auto. simpl. now apply own_sound.
Qed.
End Sound.
End Letters.

(** ** The states of a text *)

Inductive block_reading :=
| At (x : term) (bound : list nat)     (* a term, and the variables that have a value *)
| Ended (v : verdict)
| Unsettled                            (* the depth ran out, or the rules do not say *)
| Impossible.                          (* after a letter that no event makes *)

Definition same_block (r r' : block_reading) : bool :=
  match r, r' with
  | At x l, At y m => same_term x y && same_list Nat.eqb l m
  | Ended v, Ended w => same_verdict v w
  | Unsettled, Unsettled | Impossible, Impossible => true
  | _, _ => false
  end.

Lemma same_block_iff : forall r r', same_block r r' = true <-> r = r'.
Proof.
  intros [x l | v | |] [y m | w | |]; simpl; rewrite ?andb_true_iff, ?same_term_iff, ?same_verdict_iff,
    ?(same_list_iff _ _ Nat.eqb_eq); split; try congruence; try tauto; intuition congruence.
Qed.

Definition hash_block (mix : mixing) (r : block_reading) : nat :=
  match r with
  | At x l => fold_left mix l (hash_term mix x)
  | Ended Top => 13
  | Ended Bottom => 14
  | Ended Unknown | Unsettled => 15
  | Impossible => 16
  end.

Section Text.
Variable mix : mixing.
Variable t : tree.
Variable w : selection.
Variable s : semantics.
Variable ps : list predicate.
Variables basic composed : list atom.
Variable shared : list nat.
Variable depth : nat.
Variable equations : list term.

Notation qs := (basic ++ composed).
Notation sat := (slice_satisfies t ps qs).
Notation patterns := (map atom_pattern qs).
Notation numbers := (all_numbers ps basic composed).
Notation first := (S (length ps)).
Notation xs := (slice_shapes t ps qs w).
Notation cs := (scenes t w ps qs).

Definition settle_block (x : term) (bound : list nat) : block_reading :=
  match halts_in equations depth x with Some true => Ended Top | Some false => At x bound | None => Unsettled end.

(** The variables that event types ask for, of which one may take the next event. *)
Fixpoint asked_for (depth : nat) (x : term) : list nat :=
  match depth with
  | O => []
  | S depth =>
    match x with
    | All | Empty | Nothing => []
    | OfType ty => type_variables first qs shared ty
    | Union x y | Intersection x y | Shuffle x y | Filter _ x y => asked_for depth x ++ asked_for depth y
    | Concat x y => asked_for depth x ++ match halts_in equations depth x with Some true => asked_for depth y | _ => [] end
    | Star x | Optional x => asked_for depth x
    | Call n => asked_for depth (body equations n)
    end
  end.

Definition hidden_at (x : term) : list nat :=
  let asked := asked_for depth x in filter (fun y => negb (Conditions.member y asked)) shared.

(** The variables that have a value, in the order of the block. *)
Definition with_values (bound news : list nat) : list nat :=
  filter (fun x => Conditions.member x bound || Conditions.member x news) shared.

Definition block_step (is_possible : list nat -> list nat -> letter -> bool) (r : block_reading) (a : letter) : block_reading :=
  match r with
  | At x bound =>
    let hidden := hidden_at x in
    if is_possible bound hidden a then
      match go_in equations first qs shared bound hidden (predicates_of a) depth x with
      | Some (Some (y, news)) => settle_block y (with_values bound news)
      | Some None => Ended Bottom
      | None => Unsettled
      end
    else Impossible
  | Ended _ | Unsettled | Impossible => r
  end.

Definition block_fits (cs : list scene) (r : block_reading) (q : state) : bool :=
  match r with
  | At x bound => same_verdict Unknown (verdict_at q) && fair_state t qs shared s cs (hidden_at x) bound q
  | Ended v => same_verdict v (verdict_at q)
  | Unsettled => false
  | Impossible => true
  end.

(** The comparison over all letters; [fuel] bounds the pairs of states. *)
Definition compare_block (fuel : nat) (x : term) : outcome :=
  let is_possible := possible ps basic composed in
  let scenes := cs in
  match settle_block x [] with
  | At _ _ as first =>
    if all_among (alphabet xs) numbers
    then compare_with_automaton mix same_block (hash_block mix) (fun r l => map (block_step is_possible r) l)
           (block_fits scenes) s (map rows xs)
           (distinct_letters mix (slice_letters t ps basic composed)) fuel first
    else Exhausted
  | _ => Refuted []
  end.

Definition certify_text_block (fuel : nat) (x : term) : refusal + outcome :=
  if negb (well_formed t) then inl NotWellFormed
  else if negb (all_untimed t w) then inl NotPlain
  else if negb (all_placed t qs w && parts_placed basic composed) then inl NotListed
  else if negb (determined patterns) then inl NotDetermined
  else inr (compare_block fuel x).

Section Correct.
Variable fuel : nat.
Variable start : term.
Hypothesis well : WellFormed t.
Hypothesis untimed : all_untimed t w = true.
Hypothesis atoms_placed : all_placed t qs w = true.
Hypothesis parts : parts_placed basic composed = true.
Hypothesis patterns_determined : determined patterns = true.
Hypothesis compared : compare_block fuel start = Certified.

Notation step := (block_step (possible ps basic composed)).
Notation letter_at y := (letter_of sat numbers y).
Notation read p := (fold_left step (map (letter_of sat numbers) p) (settle_block start [])).
Notation reached p := (automaton_after sat numbers s xs p).

Lemma numbers_cover : In relevance numbers /\ Forall (well_lettered numbers) xs.
Proof.
  unfold compare_block in compared. cbv zeta in compared.
  destruct (settle_block start []); try discriminate.
  destruct (all_among (alphabet xs) numbers) eqn:A; [| discriminate]. now apply alphabet_among.
Qed.

(** What is read fits the state of the automaton. *)
Lemma reading_good : forall p, block_fits cs (read p) (reached p) = true.
Proof.
  intros p. unfold compare_block in compared. cbv zeta in compared.
  destruct (settle_block start []) eqn:S; try discriminate.
  destruct (all_among (alphabet xs) numbers); [| discriminate].
  apply (compare_sound mix same_block (hash_block mix) _ step (block_fits cs) same_block_iff (fun _ _ => eq_refl))
    with (word := map (letter_of sat numbers) p) in compared.
  - exact compared.
  - apply Forall_forall. intros l I. apply in_map_iff in I as (y & <- & _).
    now apply distinct_letters_complete, slice_letters_complete.
Qed.

Lemma closed_letters : forall y k, k < first -> predicates_of (letter_at y) k = satisfies t ps k (fst y).
Proof.
  intros y k K. unfold predicates_of. rewrite member_letter.
  - unfold slice_satisfies. now replace (k <=? length ps) with true by (symmetry; apply Nat.leb_le; lia).
  - unfold all_numbers, closed_numbers. rewrite !in_app_iff, !in_seq. lia.
Qed.

Lemma atom_letters : forall y k q, first <= k -> nth_error qs (k - first) = Some q ->
  predicates_of (letter_at y) k = observes q y.
Proof.
  intros y k q K N. unfold predicates_of. rewrite member_letter.
  - unfold slice_satisfies. replace (k <=? length ps) with false by (symmetry; apply Nat.leb_gt; lia). now rewrite N.
  - assert (L : k - first < length qs) by (apply nth_error_Some; congruence). rewrite app_length in L.
    unfold all_numbers, closed_numbers, basic_numbers, composed_numbers. rewrite !in_app_iff, !in_seq. lia.
Qed.

(** From a state of the text on: the verdict by the rules is that of the tree. *)
Lemma block_from : forall u u0 p b bound x, Followed t w ps qs shared s u0 p b (hidden_at x) bound ->
  read p = At x bound -> Halts equations x false -> all_defined_values b ->
  (forall x, binds b x = true -> Conditions.member x shared = true) -> Forall json_event u ->
  exists v, BlockVerdict equations (satisfies t ps) first qs shared b x u v /\ VerdictOfTree t w s (u0 ++ u) v.
Proof.
  destruct numbers_cover as [RN WL].
  induction u as [| e u IH]; intros u0 p b bound x F R H D SH J.
  - exists Unknown. split; [now constructor |]. rewrite app_nil_r. assert (G := reading_good p). rewrite R in G.
    apply andb_true_iff in G as [G _]. apply same_verdict_iff in G. rewrite G.
    eapply followed_verdict; eauto.
  - inversion J as [| ? ? JE JU]; subst. assert (BI := followed_bound _ _ _ _ _ _ _ _ _ _ _ F).
    set (hidden := hidden_at x) in *.
    set (y := (e, completed patterns hidden b e)). assert (G := reading_good (p ++ [y])).
    assert (V : VerdictOfTree t w s (u0 ++ [e]) (verdict_at (reached (p ++ [y])))).
    { apply (followed_verdict t w ps qs shared well untimed atoms_placed patterns_determined s numbers RN WL u0 p b
        hidden bound F). }
    assert (RS : read (p ++ [y]) = step (At x bound) (letter_at y)).
    { rewrite map_app, fold_left_app. simpl. now rewrite R. }
    rewrite RS in G. cbn [block_step] in RS, G. cbv zeta in RS, G. fold hidden in RS, G.
    assert (PO := possible_sound t ps basic composed patterns_determined b e bound hidden BI JE D). fold y in PO.
    rewrite PO in G, RS.
    destruct (go_in equations first qs shared bound hidden (predicates_of (letter_at y)) depth x) as [r |] eqn:GO;
      [| discriminate].
    destruct (go_in_sound equations (satisfies t ps) first qs shared patterns_determined b e bound hidden
      (predicates_of (letter_at y)) BI SH (closed_letters y) (atom_letters y) depth x r GO) as (r' & S & M).
    replace (u0 ++ e :: u) with ((u0 ++ [e]) ++ u) by now rewrite <- app_assoc.
    destruct r as [[z news] |], r' as [[z' c] |]; try (destruct M; fail).
    + destruct M as [Z GE]. simpl in Z, GE. subst z'. unfold settle_block in G, RS.
      destruct (halts_in equations depth z) as [[] |] eqn:HA; try discriminate; apply halts_in_sound in HA.
      * exists Top. split; [eapply block_goes_on; eauto; now constructor |]. apply top_is_final.
        cbn [block_fits] in G. apply same_verdict_iff in G. now rewrite G.
      * destruct GE as [GE NEW]. cbn [fst snd] in GE, NEW.
        assert (BN : forall k, binds c k = Conditions.member k (with_values bound news)).
        { intros k. apply eq_true_iff_eq. unfold with_values.
          rewrite Conditions.member_iff, filter_In, orb_true_iff, <- BI, !Conditions.member_iff. split.
          - intros B. destruct (b k) as [v |] eqn:BK.
            + assert (BB : binds b k = true) by (unfold binds; now rewrite BK).
              split; auto. now apply Conditions.member_iff, SH.
            + unfold binds in B. rewrite GE, BK in B. destruct (Conditions.member k news) eqn:N; [| discriminate].
              apply Conditions.member_iff in N. split; auto. now apply NEW.
          - intros [_ [B | N]]; [| now apply NEW]. unfold binds in *. rewrite GE. now destruct (b k). }
        assert (GR : grows b c) by (intros k v Q; rewrite GE; now rewrite Q).
        assert (CO : forall k v, c k = Some v -> completed patterns hidden b e k = Some v).
        { intros k v Q. exact (gets_completed qs shared b e hidden c news k v (conj GE NEW) Q). }
        assert (FA : Fair t w ps qs shared s (hidden_at z) (with_values bound news) (p ++ [y])).
        { cbn [block_fits] in G. apply andb_true_iff in G as [G FS]. apply same_verdict_iff in G.
          eapply fair_state_fair; eauto. }
        assert (F' := followed_event t w ps qs shared s u0 p b hidden bound e c _ _ F GR CO BN FA).
        destruct (IH (u0 ++ [e]) (p ++ [y]) c (with_values bound news) z) as (v & BV & TV); auto.
        -- intros k v Q. apply CO in Q. now apply (completed_defined patterns hidden b e patterns_determined JE D k).
        -- intros k B. rewrite BN in B. apply Conditions.member_iff, filter_In in B as [B _].
           now apply Conditions.member_iff.
        -- exists v. split; auto. eapply block_goes_on; eauto.
    + exists Bottom. split; [now constructor |]. apply bottom_is_final; [now apply well_formed_iff |].
      cbn [block_fits] in G. apply same_verdict_iff in G. now rewrite G.
Qed.

(** The text has the verdict of the tree on every trace. *)
Lemma block_verdict : forall u, Forall json_event u -> exists v,
  BlockVerdict equations (satisfies t ps) first qs shared unbound start u v /\ VerdictOfTree t w s u v.
Proof.
  destruct numbers_cover as [RN WL]. intros u J. assert (G := reading_good []). simpl in G.
  assert (S : settle_block start [] = At start [] /\ Halts equations start false).
  { unfold compare_block in compared. cbv zeta in compared. unfold settle_block in *.
    destruct (halts_in equations depth start) as [[] |] eqn:HA; try discriminate.
    apply halts_in_sound in HA. auto. }
  destruct S as [S HA]. rewrite S in G. cbn [block_fits] in G. apply andb_true_iff in G as [G FS].
  apply same_verdict_iff in G. apply (block_from u [] [] unbound [] start); auto.
  - constructor. eapply fair_state_fair; eauto.
  - intros x v Q. discriminate.
  - intros x B. discriminate.
Qed.
End Correct.

Theorem certify_text_block_correct : forall fuel x, certify_text_block fuel x = inr Certified ->
  forall u v, Forall json_event u ->
  (BlockVerdict equations (satisfies t ps) first qs shared unbound x u v <-> VerdictOfTree t w s u v).
Proof.
  intros fuel x H u v J. unfold certify_text_block in H.
  destruct (well_formed t) eqn:W; [| discriminate]. destruct (all_untimed t w) eqn:U; [| discriminate].
  destruct (all_placed t qs w && parts_placed basic composed) eqn:P; [| discriminate].
  apply andb_true_iff in P as [P PP]. destruct (determined patterns) eqn:D; [| discriminate].
  injection H as H. apply well_formed_iff in W.
  destruct (block_verdict fuel x W U P PP D H u J) as (v' & B & V). split; intros K.
  - now rewrite (block_unique _ _ _ _ _ _ _ _ _ K _ B).
  - apply (tree_plans_verdict t w W (untimed_basic _ _ U)) in K, V. now rewrite (verdict_only _ _ _ _ _ _ K V).
Qed.
End Text.
