(** * The letters that events make under assignments

    An atom is the conjunction of its pattern and its guards, so a letter is given by the patterns and the
    guards that hold.  Of these, all letters are kept that no pattern excludes and that satisfy what an
    event with such patterns and guards satisfies without an assignment. *)

Require Import List Bool Arith ZArith Lia.
Require Import RVAFT.Values RVAFT.Language RVAFT.Definition RVAFT.Search RVAFT.Conditions RVAFT.Scenarios.
Require Import RVAFT.Monitor RVAFT.Plain RVAFT.Automaton RVAFT.Exploration RVAFT.Letters RVAFT.PlainTree
  RVAFT.Relevance.
Require Import RVAFT.Slices RVAFT.SlicedTree RVAFT.SlicedCertificate.
Import ListNotations.

(** ** The parts of an atom *)

Definition pattern_atom (q : atom) : atom := SlicedAtom (atom_pattern q) (atom_time q) [].
Definition guard_atom (g : guard) : atom := SlicedAtom Anything None [g].
Definition parts_of (q : atom) : list atom := pattern_atom q :: map guard_atom (atom_guards q).

Lemma observes_guard : forall g e b, observes (guard_atom g) (e, b) = negb (late e) && passes b g.
Proof. intros g e b. unfold observes. simpl. destruct (late e); simpl; auto. apply andb_true_r. Qed.

Lemma observes_parts : forall q y, observes q y = forallb (fun r => observes r y) (parts_of q).
Proof.
  intros q [e b]. unfold parts_of. cbn [forallb]. rewrite forallb_map.
  assert (H : observes q (e, b) = observes (pattern_atom q) (e, b) && forallb (passes b) (atom_guards q)).
  { unfold observes, pattern_atom, atom_variables. cbn [atom_pattern atom_time atom_guards forallb].
    now rewrite andb_true_r. }
  rewrite H. destruct (late e) eqn:L.
  - assert (N : observes (pattern_atom q) (e, b) = false) by (unfold observes; now rewrite L). now rewrite N.
  - f_equal. apply forallb_ext_in. intros g _. now rewrite observes_guard, L.
Qed.

Lemma filter_table : forall A (f : nat -> bool) (test : list nat -> bool) (h : A -> list nat) l from,
  (forall i q, nth_error l i = Some q -> test (h q) = f (from + i)) ->
  map fst (filter (fun x => test (snd x)) (combine (seq from (length l)) (map h l))) = filter f (seq from (length l)).
Proof.
  intros A f test h; induction l as [| q l IH]; intros from H; auto. simpl. rewrite (H 0 q) by reflexivity.
  rewrite Nat.add_0_r. rewrite <- (IH (S from)).
  - destruct (f from); reflexivity.
  - intros i r N. rewrite (H (S i) r N). f_equal. lia.
Qed.

(** ** Numbers of patterns, guards and atoms *)

Definition once_each (l : list atom) : list atom :=
  fold_right (fun q l => if existsb (same_atom q) l then l else q :: l) [] l.

Section Letters.
Variable t : tree.
Variable ps : list predicate.
Variables basic composed : list atom.     (* patterns and guards; atoms that are made of these *)

Notation qs := (basic ++ composed).
Notation sat := (slice_satisfies t ps qs).
Notation number := (atom_number ps qs).

Definition closed_numbers : list nat := seq 0 (S (length ps)).
Definition basic_numbers : list nat := seq (S (length ps)) (length basic).
Definition composed_numbers : list nat := seq (S (length ps) + length basic) (length composed).
Definition all_numbers : list nat := closed_numbers ++ basic_numbers ++ composed_numbers.

Lemma place_app : forall q l m, place q l < length l -> place q (l ++ m) = place q l.
Proof.
  intros q; induction l as [| r l IH]; intros m L; simpl in *; [lia |].
  destruct (same_atom q r); auto. rewrite IH; auto. lia.
Qed.

Lemma basic_number : forall q, placed basic q = true -> In (number q) basic_numbers /\ placed qs q = true.
Proof.
  intros q P. unfold placed in *. apply Nat.ltb_lt in P. unfold atom_number. rewrite place_app, app_length by exact P.
  split; [apply in_seq; lia | apply Nat.ltb_lt; lia].
Qed.

Lemma member_basic : forall q y, placed basic q = true ->
  Automaton.member (number q) (letter_of sat basic_numbers y) = observes q y.
Proof.
  intros q y P. destruct (basic_number q P) as [I L]. rewrite member_letter by exact I. now apply atom_satisfied.
Qed.

(** *** Patterns that exclude each other *)

Definition atoms_conflict (k l : nat) : bool :=
  match nth_error qs (k - S (length ps)), nth_error qs (l - S (length ps)) with
  | Some q, Some r => (S (length ps) <=? k) && (S (length ps) <=? l) && exclude (atom_pattern q) (atom_pattern r)
  | _, _ => false
  end.

Lemma atoms_conflict_sound : forall y k l, atoms_conflict k l = true -> sat k y = true -> sat l y = true -> False.
Proof.
  intros [e b] k l C K L. unfold atoms_conflict in C. destruct (nth_error qs (k - _)) as [q |] eqn:Q;
    [| discriminate].
  destruct (nth_error qs (l - _)) as [r |] eqn:R; [| discriminate]. rewrite !andb_true_iff in C.
    destruct C as [[A B] C].
  apply Nat.leb_le in A, B. unfold slice_satisfies in K, L.
  replace (k <=? length ps) with false in K by (symmetry; apply Nat.leb_gt; lia).
  replace (l <=? length ps) with false in L by (symmetry; apply Nat.leb_gt; lia). rewrite Q in K. rewrite R in L.
  apply observes_iff in K as (_ & _ & (a & _ & M) & _), L as (_ & _ & (a' & _ & N) & _).
  eapply exclude_sound; eauto.
Qed.

(** *** What follows for predicates with variables of their own *)

(** A predicate with the numbers of the atoms of its pattern, and those of its guards. *)
Definition consequences : list (nat * (list nat * list nat)) :=
  flat_map (fun x : nat * predicate =>
    let '(k, (p, gs)) := x in
    if forallb (fun g => is_nil (points g) && placed basic (guard_atom g) &&
                         forallb (fun x => Conditions.member x (pattern_variables p)) (variables g)) gs
    then [(k, (map number (filter (fun q => same_pattern (atom_pattern q) p && placed basic q) basic),
               map (fun g => number (guard_atom g)) gs))]
    else []) (combine (seq 1 (length ps)) ps).

Definition following (table : list (nat * (list nat * list nat))) (l : letter) : list nat :=
  map fst (filter (fun x => existsb (fun k => Automaton.member k l) (fst (snd x)) &&
                            forallb (fun k => Automaton.member k l) (snd (snd x))) table).
Definition follow : letter -> list nat := following consequences.

Lemma follow_sound : forall e b k, In k (follow (letter_of sat basic_numbers (e, b))) -> satisfies t ps k e = true.
Proof.
  intros e b k I. unfold follow, following in I. apply in_map_iff in I as ([k' [bs gs]] & <- & I).
  apply filter_In in I as [I H]. cbn [fst snd] in *. apply andb_true_iff in H as [H H'].
  apply in_flat_map in I as ([k [p gs']] & C & I).
  apply (combine_seq _ _ (Anything, [])) in C as [C N].
  destruct (forallb _ gs') eqn:F; [| destruct I]. destruct I as [I | []]. injection I as -> <- <-.
  apply existsb_exists in H as (n & I & H). apply in_map_iff in I as (q & <- & I). apply filter_In in I as [I P].
  apply andb_true_iff in P as [P PL]. apply same_pattern_eq in P. rewrite member_basic in H by exact PL.
  apply observes_iff in H as (L & V & FP & _ & _). rewrite P in FP.
  assert (NTH : nth_error ps (k' - 1) = Some (p, gs')) by (rewrite N; apply nth_error_nth'; lia).
  destruct k' as [| i]; [lia |]. simpl in NTH. rewrite Nat.sub_0_r in NTH. simpl. rewrite NTH.
  unfold meets. rewrite L. simpl. apply bindings_iff in FP as (bs & J & R). apply existsb_exists.
    exists bs; split; auto.
  apply forallb_forall. intros g G. rewrite forallb_forall in F, H'. assert (FG := F g G).
    rewrite !andb_true_iff in FG.
  destruct FG as [[PT PG] VG]. apply is_nil_iff in PT. rewrite forallb_forall in VG.
  assert (X := H' (number (guard_atom g))). rewrite member_basic in X by exact PG. rewrite observes_guard, L in X.
  simpl in X. assert (PA : passes b g = true) by (apply X, in_map_iff; eauto). clear X.
  assert (W : forall x, In x (variables g) -> In x (pattern_variables p)) by (intros x Y;
    now apply Conditions.member_iff, VG).
  unfold passes in PA. apply orb_true_iff in PA as [PA | PA].
  - apply negb_true_iff in PA. rewrite <- not_true_iff_false in PA. exfalso. apply PA, forallb_forall. intros x Y.
    apply V. unfold atom_variables. rewrite P. apply in_app_iff. auto.
  - rewrite <- PA. apply holds_same; [| rewrite PT; intros ? []]. intros x Y.
    apply (respects_get Nat.eqb Nat.eqb_eq); auto. apply (bindings_variables p (content e)); auto.
Qed.

(** The number of a pattern with variables of its own, and the number of an atom of this pattern. *)
Definition pattern_numbers : list (nat * nat) :=
  flat_map (fun q =>
    let bare : predicate := (atom_pattern q, []) in
    if placed basic q && listed ps bare then [(number_in ps bare, number q)] else []) basic.

Lemma pattern_numbers_sound : forall e b k n, In (k, n) pattern_numbers -> sat n (e, b) = true ->
  satisfies t ps k e = true.
Proof.
  intros e b k n I S. apply in_flat_map in I as (q & _ & I). cbv zeta in I.
  destruct (placed basic q && listed ps (atom_pattern q, [])) eqn:H; [| destruct I].
  destruct I as [I | []]. injection I as <- <-. apply andb_true_iff in H as [P L].
  rewrite (atom_satisfied t ps qs q) in S by now apply basic_number. rewrite listed_numbered by exact L.
  apply observes_iff in S as (NL & _ & F & _). unfold meets. rewrite NL. simpl.
  apply bindings_iff in F as (bs & J & _). apply existsb_exists. exists bs; auto.
Qed.

(** The numbers of atoms that an event may make true, beside a letter of predicates with variables of their own. *)
Definition allowed (table : list (nat * nat)) (a : letter) (numbers : list nat) : list nat :=
  filter (fun n => negb (existsb (fun kn => Nat.eqb (snd kn) n && negb (Automaton.member (fst kn) a)) table)) numbers.

Lemma allowed_letter : forall e b, let a := letter_of (satisfies t ps) closed_numbers e in
  letter_of sat (allowed pattern_numbers a basic_numbers) (e, b) = letter_of sat basic_numbers (e, b).
Proof.
  intros e b a. unfold letter_of, allowed. generalize basic_numbers as l. induction l as [| n l IH]; auto. simpl.
  destruct (existsb _ pattern_numbers) eqn:X; simpl; [| destruct (sat n (e, b)); now rewrite IH].
  rewrite IH. destruct (sat n (e, b)) eqn:S; auto. exfalso.
  apply existsb_exists in X as ([k m] & I & X). simpl in X. apply andb_true_iff in X as [Q M].
  apply Nat.eqb_eq in Q. subst m. apply negb_true_iff in M.
  assert (T := pattern_numbers_sound e b k n I S). unfold a in M. rewrite member_letter in M; [congruence |].
  apply in_flat_map in I as (q & _ & I). cbv zeta in I.
  destruct (placed basic q && listed ps (atom_pattern q, [])) eqn:H; [| destruct I].
  destruct I as [I | []]. injection I as <- _. apply andb_true_iff in H as [_ L]. apply Nat.ltb_lt in L.
  unfold closed_numbers, number_in. apply in_seq. lia.
Qed.

(** An atom without variables is its pattern: the numbers of both. *)
Definition without_variables : list (nat * nat) :=
  flat_map (fun q =>
    let bare : predicate := (atom_pattern q, []) in
    if is_nil (atom_variables q) && is_nil (atom_guards q) && placed basic q && listed ps bare
    then [(number_in ps bare, number q)] else []) basic.

Lemma without_variables_sound : forall e b k n, In (k, n) without_variables -> satisfies t ps k e = true ->
  Automaton.member n (letter_of sat basic_numbers (e, b)) = true.
Proof.
  intros e b k n I S. apply in_flat_map in I as (q & _ & I). cbv zeta in I.
  destruct (is_nil (atom_variables q) && is_nil (atom_guards q) && placed basic q && listed ps (atom_pattern q,
    [])) eqn:H;
    [| destruct I].
  destruct I as [I | []]. injection I as <- <-. rewrite !andb_true_iff in H. destruct H as [[[V G] P] L].
  apply is_nil_iff in V, G. rewrite listed_numbered in S by exact L. rewrite member_basic by exact P.
  unfold meets in S. apply andb_true_iff in S as [NL S]. apply existsb_exists in S as (bs & J & _).
  unfold atom_variables in V. apply app_eq_nil in V as [V T].
  apply observes_iff. split; [now apply negb_true_iff |]. unfold atom_variables. rewrite V, T, G.
  split; [intros x [] |]. split; [| split; [intros x X; rewrite X in T; discriminate | intros g []]].
  apply fits_pattern_same with (get Nat.eqb bs); [rewrite V; intros x [] |].
  apply bindings_iff. exists bs; split; auto. now apply (bindings_agree (atom_pattern q) (content e)).
Qed.

(** *** Composed atoms *)

Definition compositions : list (nat * list nat) :=
  combine composed_numbers (map (fun q => map number (parts_of q)) composed).

Definition composed_by (table : list (nat * list nat)) (l : letter) : letter :=
  map fst (filter (fun x => forallb (fun k => Automaton.member k l) (snd x)) table).
Definition compose : letter -> letter := composed_by compositions.

Definition parts_placed : bool := forallb (fun q => forallb (placed basic) (parts_of q)) composed.

Lemma compose_correct : forall y, parts_placed = true ->
  compose (letter_of sat basic_numbers y) = letter_of sat composed_numbers y.
Proof.
  intros y P. unfold compose, composed_by, compositions, composed_numbers, letter_of. unfold parts_placed in P.
  rewrite forallb_forall in P.
  assert (X : forall i q, nth_error composed i = Some q ->
    forallb (fun k => Automaton.member k (filter (fun p => sat p y) basic_numbers)) (map number (parts_of q)) =
    sat (S (length ps) + length basic + i) y).
  { intros i q N. assert (I : In q composed) by (eapply nth_error_In; eauto). specialize (P q I).
    rewrite forallb_map. rewrite forallb_forall in P.
    rewrite (forallb_ext_in _ _ (fun r => observes r y)) by (intros r R; now apply member_basic, P).
    rewrite <- observes_parts. unfold slice_satisfies.
    replace (S (length ps) + length basic + i <=? length ps) with false by (symmetry; apply Nat.leb_gt; lia).
    replace (S (length ps) + length basic + i - S (length ps)) with (length basic + i) by lia.
    rewrite nth_error_app2 by lia. replace (length basic + i - length basic) with i by lia. now rewrite N. }
  apply (filter_table _ (fun k => sat k y)
    (fun l => forallb (fun k => Automaton.member k (filter (fun p => sat p y) basic_numbers)) l)). exact X.
Qed.
End Letters.
