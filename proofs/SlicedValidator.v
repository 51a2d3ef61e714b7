(** * The validator of texts of LTLf and HOA

    A text is compared with the scenarios of the tree over the letters of [SlicedLetters.v], of which only
    the predicates count that the text or the scenarios use. *)

Require Import List Bool Arith ZArith Lia.
Require Import RVAFT.Values RVAFT.Language RVAFT.Definition RVAFT.Search RVAFT.Conditions RVAFT.Scenarios.
Require Import RVAFT.Monitor RVAFT.Plain RVAFT.Automaton RVAFT.Acceptance RVAFT.Exploration RVAFT.Hoa RVAFT.Ltlf.
Require Import RVAFT.Progression RVAFT.Letters RVAFT.Validator RVAFT.PlainTree RVAFT.Relevance.
Require Import RVAFT.Slices RVAFT.SlicedTree RVAFT.SlicedCertificate RVAFT.SlicedLetters.
Import ListNotations.

(** ** Letters, each once *)

Definition same_letter : letter -> letter -> bool := same_list Nat.eqb.
Definition hash_letter (mix : mixing) (a : letter) : nat := fold_left mix a 7.

Lemma same_letter_iff : forall a b, same_letter a b = true <-> a = b.
Proof. apply same_list_iff, Nat.eqb_eq. Qed.

Definition distinct_letters (mix : mixing) (l : list letter) : list letter :=
  snd (fold_left (fun found a =>
    let h := hash_letter mix a in
    if stored same_letter h a (fst found) then found else (put_in h a (fst found), a :: snd found)) l (Vacant, [])).

Lemma distinct_letters_complete : forall mix l a, In a l -> In a (distinct_letters mix l).
Proof.
  intros mix l a I. unfold distinct_letters.
  assert (X : forall l found, (forall b, has same_letter (hash_letter mix) (fst found) b -> In b (snd found)) ->
    (forall b, In b (snd found) -> In b (snd (fold_left (fun found a =>
      let h := hash_letter mix a in
      if stored same_letter h a (fst found) then found else (put_in h a (fst found), a :: snd found)) l found))) /\
    (forall b, In b l -> In b (snd (fold_left (fun found a =>
      let h := hash_letter mix a in
      if stored same_letter h a (fst found) then found else (put_in h a (fst found), a :: snd found)) l found)))).
  { clear. induction l as [| c l IH]; intros found H; [simpl; tauto |]. cbn [fold_left]. cbv zeta.
    destruct (stored same_letter (hash_letter mix c) c (fst found)) eqn:S.
    - destruct (IH found H) as [A B]. split; auto. intros b [<- | J]; auto.
    - assert (H' : forall b, has same_letter (hash_letter mix) (put_in (hash_letter mix c) c (fst found)) b ->
        In b (c :: snd found)).
      { intros b J. apply (has_put _ _ same_letter_iff (fun _ => []) (fun _ => true)) in J.
        destruct J as [-> | J]; [now left | right; exact (H b J)]. }
      destruct (IH (put_in (hash_letter mix c) c (fst found), c :: snd found) H') as [A B].
      split; [intros b J; apply A; simpl; auto |]. intros b [<- | J]; auto. apply A; simpl; auto. }
  apply (X l (Vacant, [])); auto. intros b J. discriminate.
Qed.

(** ** The letters of a tree under assignments *)

Section Letters.
Variable t : tree.
Variable ps : list predicate.
Variables basic composed : list atom.

Notation qs := (basic ++ composed).
Notation sat := (slice_satisfies t ps qs).

(** Each letter of basic atoms, with the letters of predicates that have variables of their own. *)
Definition slice_letters : list letter :=
  let compositions := compositions ps basic composed in
  let consequences := consequences ps basic composed in
  let equal := without_variables ps basic composed in
  let patterns := pattern_numbers ps basic composed in
  let conflict := atoms_conflict ps basic composed in
  flat_map (fun a => map (fun l => a ++ l ++ composed_by compositions l) (filter (fun l =>
      forallb (fun k => Automaton.member k a) (following consequences l) &&
      forallb (fun kn => implb (Automaton.member (fst kn) a) (Automaton.member (snd kn) l)) equal)
    (letters_over conflict (allowed patterns a (basic_numbers ps basic)))))
    (related_letters t ps).

Lemma letter_of_app : forall E (f : nat -> E -> bool) l m y, letter_of f (l ++ m) y = letter_of f l y ++ letter_of
  f m y.
Proof. intros E f l m y. apply filter_app. Qed.

Lemma closed_letter : forall e b, letter_of sat (closed_numbers ps) (e, b) = letter_of (satisfies t ps)
  (closed_numbers ps) e.
Proof.
  intros e b. apply filter_ext_in. intros k I. unfold closed_numbers in I. apply in_seq in I.
  unfold slice_satisfies. replace (k <=? length ps) with true by (symmetry; apply Nat.leb_le; lia). reflexivity.
Qed.

Lemma slice_letters_complete : forall y, parts_placed basic composed = true ->
  In (letter_of sat (all_numbers ps basic composed) y) slice_letters.
Proof.
  intros [e b] P. unfold all_numbers. rewrite !letter_of_app, closed_letter. apply in_flat_map.
  exists (letter_of (satisfies t ps) (closed_numbers ps) e). split; [apply related_letters_complete |].
  set (l := letter_of sat (basic_numbers ps basic) (e, b)).
  rewrite <- compose_correct by exact P. fold l. apply in_map_iff.
  exists l. split; auto. apply filter_In. split.
  - unfold l. rewrite <- (allowed_letter t ps basic composed e b). apply letters_over_complete. intros p q.
    apply atoms_conflict_sound.
  - apply andb_true_iff; split; apply forallb_forall.
    2:{ intros [k n] I. cbn [fst snd]. destruct (Automaton.member k _) eqn:M; auto. cbn [implb].
      apply Automaton.member_iff in M. apply filter_In in M as [_ M]. now apply (without_variables_sound t ps _ _ e
        b k n). }
    intros k I. unfold l in I. assert (T := follow_sound _ _ _ _ _ _ _ I).
    assert (K : k < S (length ps)).
    { unfold follow, following in I. apply in_map_iff in I as ([k' x] & <- & I). apply filter_In in I as [I _].
      apply in_flat_map in I as ([k [p gs]] & C & I). destruct (forallb _ gs) in I; [| destruct I].
      destruct I as [I | []]. injection I as Q _. apply (combine_seq _ _ (Anything, [])) in C as [C _]. subst k'.
        apply C. }
    rewrite member_letter by (apply in_seq; lia). exact T.
Qed.
End Letters.

(** ** An event for each atom *)

(** The assignment of an atom by an event. *)
Definition assigned_by (q : atom) (e : event) (bs : binding nat) : assignment := fun x =>
  match lookup Nat.eqb bs x with
  | Some v => Some v
  | None => if same_time (atom_time q) (Some x) then Some (time_value e) else None
  end.

Definition observed_in (events : list event) (q : atom) : bool :=
  existsb (fun e => existsb (fun bs => observes q (e, assigned_by q e bs)) (bindings (atom_pattern q) (content e)))
    events.

Definition all_observed (t : tree) (w : selection) (s : semantics) (values : list value) : bool :=
  let relevant := relevant_event t in
  let events := filter (fun e => match s with Projected | Consecutive => relevant e | Strict | Scattered => true end)
                  (map (fun v => Event v (Some 0%Z) false) values) in
  forallb (observed_in events) (once_each (concat (shape_atoms t w))).

Lemma once_each_complete : forall l q, In q l -> In q (once_each l).
Proof.
  induction l as [| r l IH]; intros q I; [destruct I |]. simpl.
  destruct (existsb (same_atom r) (once_each l)) eqn:X; destruct I as [<- | I]; simpl; auto.
  apply existsb_exists in X as (q & I & E). apply same_atom_eq in E. now subst.
Qed.

Lemma all_observed_servable : forall t ps qs w s values, all_placed t qs w = true ->
  all_observed t w s values = true -> Forall (servable (slice_satisfies t ps qs) s) (slice_shapes t ps qs w).
Proof.
  intros t ps qs w s values P H. apply Forall_forall. intros x I o O.
  apply in_shapes in I as (r & chosen & R & S & C & L & A & ->). cbv zeta in A. simpl in O.
  destruct (occurrence_atom t w r chosen o R S C L A O) as (q & l & Q & IL & IQ). simpl. rewrite Q.
  unfold all_placed in P. rewrite forallb_forall in P. specialize (P l IL). rewrite forallb_forall in P.
  unfold all_observed in H. cbv zeta in H. rewrite forallb_forall in H.
  assert (OB : observed_in (filter (fun e => match s with Projected | Consecutive => relevant_event t e
    | Strict | Scattered => true end) (map (fun v => Event v (Some 0%Z) false) values)) q = true)
    by (apply H, once_each_complete, in_concat; eauto).
  apply existsb_exists in OB as (e & IE & OB). apply existsb_exists in OB as (bs & _ & OB).
  apply filter_In in IE as [_ RE]. exists (e, assigned_by q e bs). split.
  - rewrite atom_satisfied; auto.
  - intros [-> | ->]; exact RE.
Qed.

(** ** Certificates *)

(** The closed predicates of a tree and a text: those of relevance, those that the text uses, and the bare
    patterns of the atoms. *)
Definition slice_predicates (t : tree) (others : list predicate) (atoms : list atom) : list predicate :=
  fold_right (fun q ps => if existsb (same_predicate q) ps then ps else q :: ps) []
    (relevance_entries t ++ others ++ map (fun q => (atom_pattern q, [])) atoms).

(** The atoms of a tree and a text: patterns and guards, and what is made of these. *)
Definition slice_atoms (t : tree) (w : selection) (atoms : list atom) : list atom * list atom :=
  let all := once_each (concat (shape_atoms t w) ++ atoms) in
  let basic := once_each (flat_map parts_of all) in
  (basic, filter (fun q => negb (placed basic q)) all).

Definition certify_slices (mix : mixing) (t : tree) (w : selection) (s : semantics) (ps : list predicate)
  (basic composed atoms : list atom) (given : list value) (used : list nat)
  (compare : list shape -> list nat -> list letter -> outcome) : refusal + outcome :=
  let qs := basic ++ composed in
  if negb (well_formed t) then inl NotWellFormed
  else if negb (all_timed t w) then inl NotTimed
  else if negb (all_placed t qs w && parts_placed basic composed) then inl NotListed
  else if negb (all_observed t w s given) then inl NotServed
  else
    let xs := slice_shapes t ps qs w in
    let wanted := nodup Nat.eq_dec (alphabet xs ++ used) in
    let numbers := filter (fun k => Automaton.member k wanted) (all_numbers ps basic composed) in
    let letters := distinct_letters mix (map (filter (fun k => Automaton.member k wanted)) (slice_letters t ps
      basic composed)) in
    match compare xs numbers letters with
    | Certified => if text_binds t w atoms then inr Certified else inl NotBound
    | o => inr o
    end.

Definition certify_text_hoa (mix : mixing) (t : tree) (w : selection) (s : semantics) (ps : list predicate)
  (basic composed atoms : list atom) (given : list value) (fuel : nat) (h : hoa) : refusal + outcome :=
  certify_slices mix t w s ps basic composed atoms given (hoa_atoms h)
    (fun xs numbers letters => certify_hoa mix s xs numbers letters fuel h).

Definition certify_text_ltlf (mix : mixing) (t : tree) (w : selection) (s : semantics) (ps : list predicate)
  (basic composed atoms : list atom) (given : list value) (fuel : nat) (f : formula) : refusal + outcome :=
  certify_slices mix t w s ps basic composed atoms given (Progression.atoms f)
    (fun xs numbers letters => certify_ltlf mix s xs numbers letters fuel f).

Section Correct.
Variable mix : mixing.
Variable t : tree.
Variable w : selection.
Variable s : semantics.
Variable ps : list predicate.
Variables basic composed atoms : list atom.
Variable given : list value.

Notation sat := (slice_satisfies t ps (basic ++ composed)).

Notation SliceDetected xs := (Detected (fun y => relevant sat y = true) (Scenarios (map (plain sat) xs)) s).

(** What a certificate says, when a comparison over letters is right about the traces over these. *)
Lemma certified_slices : forall used compare accepts,
  certify_slices mix t w s ps basic composed atoms given used compare = inr Certified ->
  (forall xs numbers letters, compare xs numbers letters = Certified ->
     (forall y, In (letter_of sat numbers y) letters) -> forall p, accepts p <-> SliceDetected xs p) ->
  WellFormed t /\ all_timed t w = true /\ all_placed t (basic ++ composed) w = true /\ text_binds t w atoms = true /\
  Forall (servable sat s) (slice_shapes t ps (basic ++ composed) w) /\
  forall p, accepts p <-> SliceDetected (slice_shapes t ps (basic ++ composed) w) p.
Proof.
  intros used compare accepts H A. unfold certify_slices in H. cbv zeta in H.
  destruct (well_formed t) eqn:W; [| discriminate]. destruct (all_timed t w) eqn:T; [| discriminate].
  destruct (all_placed t (basic ++ composed) w && parts_placed basic composed) eqn:P; [| discriminate].
  apply andb_true_iff in P as [P PP]. destruct (all_observed t w s given) eqn:O; [| discriminate]. simpl negb in H.
  cbv iota in H. set (wanted := nodup _ _) in H. set (numbers := filter _ (all_numbers ps basic composed)) in H.
  set (letters := distinct_letters _ _) in H.
  destruct (compare _ numbers letters) eqn:C; try discriminate.
  destruct (text_binds t w atoms) eqn:B; [| discriminate]. apply well_formed_iff in W.
  split; [exact W |]. split; [auto |]. split; [auto |]. split; [auto |]. split.
  - now apply all_observed_servable with given.
  - apply (A _ _ _ C). intros y. apply distinct_letters_complete. unfold numbers.
    assert (F : letter_of sat (filter (fun k => Automaton.member k wanted) (all_numbers ps basic composed)) y =
      filter (fun k => Automaton.member k wanted) (letter_of sat (all_numbers ps basic composed) y)).
    { unfold letter_of. generalize (all_numbers ps basic composed) as l. induction l as [| k l IH]; auto. simpl.
      destruct (Automaton.member k wanted) eqn:M, (sat k y) eqn:S; simpl; rewrite ?M, ?S, IH; reflexivity. }
    rewrite F. apply in_map. now apply slice_letters_complete.
Qed.

(** A certified automaton has the verdict of the tree on every trace, over its slices. *)
Theorem certify_text_hoa_correct : forall fuel h,
  certify_text_hoa mix t w s ps basic composed atoms given fuel h = inr Certified ->
  forall u v, SliceVerdict atoms (fun p => HoaAccepts h (valuations sat p)) u v <-> VerdictOfTree t w s u v.
Proof.
  intros fuel h H. apply (certified_slices _ _ (fun p => HoaAccepts h (valuations sat p))) in H as (W & T & P & B &
    V & A).
  - now apply (slices_verdict t ps (basic ++ composed)).
  - intros xs numbers letters C P. now apply (certify_hoa_language sat _ _ _ _ _ _ _ C P).
Qed.

(** A certified formula has the verdict of the tree on every trace, over its slices. *)
Theorem certify_text_ltlf_correct : forall fuel f,
  certify_text_ltlf mix t w s ps basic composed atoms given fuel f = inr Certified ->
  forall u v, SliceVerdict atoms (fun p => Ltlf.holds sat f p = true) u v <-> VerdictOfTree t w s u v.
Proof.
  intros fuel f H. apply (certified_slices _ _ (fun p => Ltlf.holds sat f p = true)) in H as (W & T & P & B & V & A).
  - now apply (slices_verdict t ps (basic ++ composed)).
  - intros xs numbers letters C P. now apply (certify_ltlf_language sat _ _ _ _ _ _ _ C P).
Qed.
End Correct.

(** ** Variables of one event: the verdict of section 5

    Where each node has variables of its own, and no guard is about time, the verdict over slices is that
    of section 5 of [docs/semantics.md] with extensions of the trace itself: a trace is accepted when one of
    its slices is. *)

Section OneEvent.
Variable t : tree.
Variable w : selection.
Variable own : list predicate.
Hypothesis tree_plain : plain_tree t = true.
Hypothesis own_covered : covered t own = true.

(** An event that an atom observes meets the predicate of its node. *)
Lemma observed_meets : forall r timed o q e b, In o (occurrences_of t r) ->
  scenario_atom t timed (scenario_guards t (parts t r) (guards_of t r)) o = Some q -> observes q (e, b) = true ->
  exists p, predicate_of t (fst o) = Some p /\ meets p e = true.
Proof.
  intros r timed o q e b O Q X. unfold scenario_atom in Q. unfold predicate_of.
  destruct (on (node_at t (fst o))) as [p |] eqn:P; [| discriminate]. injection Q as <-.
  apply observes_iff in X as (L & V & F & _ & G). unfold atom_variables in V. simpl in V, F, G.
  exists (p, own_conditions t (fst o)). split; auto. unfold meets. rewrite L. simpl.
  apply bindings_iff in F as (bs & J & R). apply existsb_exists. exists bs; split; auto.
  apply forallb_forall. intros g K. apply filter_In in K as [K N].
  destruct (own_guards t tree_plain _ _ K) as [PG VG]. unfold node_variables in VG. rewrite P in VG.
  assert (IG : In g (scenario_guards t (parts t r) (guards_of t r))).
  { apply in_map_iff. exists g. split; [now apply Clocks.clocked_untimed |]. apply filter_In. split; auto.
    apply guards_of_iff. exists (fst o). rewrite guards_at_basic by exact (tree_basic t tree_plain).
    split; auto. apply occurrences_iff in O. apply O. }
  assert (NV : exists x, In x (variables g)).
  { unfold is_constant in N. rewrite PG in N. destruct (variables g) as [| x l]; [discriminate | exists x; simpl;
    auto]. }
  destruct NV as (x0 & X0).
  assert (PA : passes b g = true).
  { apply G, filter_In. split; auto. apply existsb_exists. exists x0. split; auto.
    apply Conditions.member_iff, in_app_iff. left. now apply VG. }
  unfold passes in PA. apply orb_true_iff in PA as [PA | PA].
  - apply negb_true_iff in PA. rewrite <- not_true_iff_false in PA. exfalso. apply PA, forallb_forall. intros x Y.
    apply V, in_app_iff. left. now apply VG.
  - rewrite <- PA. apply holds_same; [| rewrite PG; intros ? []]. intros x Y.
    apply (respects_get Nat.eqb Nat.eqb_eq); auto. apply (bindings_variables p (content e)); auto.
Qed.

Lemma own_servable : forall ps qs s, WellFormed t -> all_placed t qs w = true ->
  Forall (servable (slice_satisfies t ps qs) s) (slice_shapes t ps qs w) ->
  Forall (servable (satisfies t own) s) (tree_shapes t w own).
Proof.
  intros ps qs s W PL H. apply Forall_forall. intros x I o O. apply in_map_iff in I as (c & <- & I).
  apply in_plans in I as (r & chosen & R & S & C & L & A & ->). simpl in O.
  set (x := slice_shape t ps qs (timed_in t w) (guards_of t r) (parts t r) (occurrences_of t r)
    (precedes (node_pairs t r) (end_pairs t r (last_in chosen)))).
  assert (IX : In x (slice_shapes t ps qs w)) by (apply in_shapes; exists r, chosen; repeat split; auto).
  rewrite Forall_forall in H. destruct (H x IX o O) as ([e b] & SA & RE). simpl in SA.
  destruct (occurrence_atom t w r chosen o R S C L A O) as (q & l & Q & IL & IQ). rewrite Q in SA.
  unfold all_placed in PL. rewrite forallb_forall in PL. specialize (PL l IL). rewrite forallb_forall in PL.
  rewrite atom_satisfied in SA by auto.
  destruct (observed_meets r _ o q e b O Q SA) as (p & P & M). exists e. simpl. rewrite P. split; [| exact RE].
  now rewrite (predicate_numbered t own own_covered (fst o) p e P).
Qed.

(** For variables of one event, a text that accepts exactly the slices with a match has the verdict of the
    tree in the sense of section 5. *)
Theorem one_event_verdict : forall ps qs s atoms accepts, WellFormed t -> all_timed t w = true ->
  all_placed t qs w = true -> text_binds t w atoms = true ->
  Forall (servable (slice_satisfies t ps qs) s) (slice_shapes t ps qs w) ->
  (forall p, accepts p <-> Detected (fun y => relevant (slice_satisfies t ps qs) y = true)
     (Scenarios (map (plain (slice_satisfies t ps qs)) (slice_shapes t ps qs w))) s p) ->
  forall u v, TextVerdict (fun u => exists p, Slice atoms u p /\ accepts p) u v <-> VerdictOfTree t w s u v.
Proof.
  intros ps qs s atoms accepts W T P B V A u v.
  assert (RE := tree_represented t own W tree_plain own_covered w).
  assert (TV := tree_verdict t w (satisfies t own) (tree_shapes t w own) (fun e => tree_relevance t own W e) RE s).
  rewrite TV. apply plain_text_verdict.
  - apply (tree_acyclic t w (satisfies t own) (tree_shapes t w own) RE).
  - now apply own_servable with ps qs.
  - intros u'. rewrite <- (TV u' Top), (tree_plans_verdict t w W (tree_basic t tree_plain) s u' Top).
    change (Verdict (fun e => relevant_event t e = true) (Scenarios (plans t w)) s u' Top)
      with (Detected (fun e => relevant_event t e = true) (Scenarios (plans t w)) s u').
    rewrite (sliced_detected t ps qs w atoms W P T B). split; intros (p & S & K); exists p; split; auto; now apply A.
Qed.
End OneEvent.

(** The same for certified texts. *)
Corollary certify_text_ltlf_one_event : forall mix t w s ps basic composed atoms given fuel f own,
  certify_text_ltlf mix t w s ps basic composed atoms given fuel f = inr Certified ->
  plain_tree t = true -> covered t own = true ->
  forall u v, TextVerdict (fun u => exists p, Slice atoms u p /\
      Ltlf.holds (slice_satisfies t ps (basic ++ composed)) f p = true) u v <-> VerdictOfTree t w s u v.
Proof.
  intros mix t w s ps basic composed atoms given fuel f own H TP CO.
  apply (certified_slices mix t w s ps basic composed atoms given _ _
    (fun p => Ltlf.holds (slice_satisfies t ps (basic ++ composed)) f p = true)) in H as (W & T & P & B & V & A).
  - now apply one_event_verdict with own ps (basic ++ composed).
  - intros xs numbers letters C P. now apply (certify_ltlf_language _ _ _ _ _ _ _ _ C P).
Qed.

Corollary certify_text_hoa_one_event : forall mix t w s ps basic composed atoms given fuel h own,
  certify_text_hoa mix t w s ps basic composed atoms given fuel h = inr Certified ->
  plain_tree t = true -> covered t own = true ->
  forall u v, TextVerdict (fun u => exists p, Slice atoms u p /\
      HoaAccepts h (valuations (slice_satisfies t ps (basic ++ composed)) p)) u v <-> VerdictOfTree t w s u v.
Proof.
  intros mix t w s ps basic composed atoms given fuel h own H TP CO.
  apply (certified_slices mix t w s ps basic composed atoms given _ _
    (fun p => HoaAccepts h (valuations (slice_satisfies t ps (basic ++ composed)) p))) in H as (W & T & P & B & V &
      A).
  - now apply one_event_verdict with own ps (basic ++ composed).
  - intros xs numbers letters C P. now apply (certify_hoa_language _ _ _ _ _ _ _ _ C P).
Qed.
