(** * Trees without shared variables and time points, and certified texts for them

    In a plain tree each occurrence has a predicate on events: the pattern of its node, with the guards
    that concern only the variables of this pattern.  Its scenarios are plain, and the certificates need
    no further conditions: everything they rely on is computed from the tree. *)

Require Import List Bool Arith ZArith Lia.
Require Import RVAFT.Values RVAFT.Language RVAFT.Definition RVAFT.Search RVAFT.Conditions RVAFT.Scenarios RVAFT.Monitor.
Require Import RVAFT.Plain RVAFT.Automaton RVAFT.Acceptance RVAFT.Exploration RVAFT.Hoa RVAFT.Ltlf RVAFT.Progression.
Require Import RVAFT.Rml RVAFT.RmlCertificate RVAFT.Letters RVAFT.Validator.
Import ListNotations.

(** ** Equality of patterns and guards *)

Section All2.
Variables (A B : Type) (f : A -> B -> bool).
Fixpoint all2 (l : list A) (m : list B) : bool :=
  match l, m with a :: l, b :: m => f a b && all2 l m | [], [] => true | _, _ => false end.
End All2.
Arguments all2 {A B}.

Lemma all2_eq : forall A (f : A -> A -> bool) l, Forall (fun a => forall b, f a b = true -> a = b) l ->
  forall m, all2 f l m = true -> l = m.
Proof.
  intros A f l F; induction F as [| a l H F IH]; intros [| b m] E; simpl in E; try discriminate; auto.
  apply andb_true_iff in E as [E E']. f_equal; auto.
Qed.

Fixpoint same_pattern (p q : pattern) : bool :=
  match p, q with
  | Exactly v, Exactly w => value_eqb v w
  | Named x, Named y => same_name x y
  | Anything, Anything => true
  | ObjectWith f, ObjectWith g => all2 (fun a b => text_eqb (fst a) (fst b) && same_pattern (snd a) (snd b)) f g
  | ListOf l, ListOf m => all2 same_pattern l m
  | SomeItem p, SomeItem q => same_pattern p q
  | _, _ => false
  end.

Lemma same_pattern_eq : forall p q, same_pattern p q = true -> p = q.
Proof.
  induction p as [w | x | | fields IH | items IH | p IH] using pattern_induction; intros q E; destruct q; simpl in E;
    try discriminate; auto.
  - apply value_eqb_iff in E. congruence.
  - apply same_name_iff in E. congruence.
  - f_equal. eapply all2_eq; [| exact E]. rewrite Forall_forall in *. intros [n p] I [m q] H. simpl in H.
    apply andb_true_iff in H as [H K]. apply text_eqb_iff in H. apply (IH (n, p) I) in K. simpl in K. congruence.
  - f_equal. eapply all2_eq; eauto.
  - f_equal; auto.
Qed.

(** Operators that are not listed are not compared. *)
Definition same_operator (o o' : operator) : bool :=
  match o, o' with
  | OneOf l, OneOf m => all2 value_eqb l m
  | Equals, Equals | Differs, Differs | Less, Less | LessOrEqual, LessOrEqual | Greater, Greater
  | GreaterOrEqual, GreaterOrEqual | Add, Add | Subtract, Subtract | Multiply, Multiply | Divide, Divide
  | Negate, Negate | Not, Not | StartsWith, StartsWith | EndsWith, EndsWith | Contains, Contains | Like, Like
  | Absolute, Absolute | Minimum, Minimum | Maximum, Maximum | ToNumber, ToNumber => true
  | _, _ => false
  end.

Lemma same_operator_eq : forall o o', same_operator o o' = true -> o = o'.
Proof.
  intros o o' E. destruct o; destruct o'; try discriminate; auto. f_equal.
  eapply all2_eq; [| exact E]. apply Forall_forall. intros v _ w H. now apply value_eqb_iff.
Qed.

(** Guards over time points are not compared: they are no part of predicates. *)
Fixpoint same_guard (g h : guard) : bool :=
  match g, h with
  | Constant v, Constant w => value_eqb v w
  | ValueOf x, ValueOf y => Nat.eqb x y
  | Apply o l, Apply o' m => same_operator o o' && all2 same_guard l m
  | AndThen a b, AndThen c d | OrElse a b, OrElse c d => same_guard a c && same_guard b d
  | _, _ => false
  end.

Lemma same_guard_eq : forall g h, same_guard g h = true -> g = h.
Proof.
  induction g as [v | x | p | o l IH | a b IHa IHb | a b IHa IHb] using guard_induction; intros h E; destruct h;
    simpl in E; try discriminate.
  - apply value_eqb_iff in E. congruence.
  - apply Nat.eqb_eq in E. congruence.
  - apply andb_true_iff in E as [E E']. apply same_operator_eq in E. f_equal; auto. eapply all2_eq; eauto.
  - apply andb_true_iff in E as [E E']. f_equal; auto.
  - apply andb_true_iff in E as [E E']. f_equal; auto.
Qed.

(** ** Predicates *)

(** An event of this pattern under which the guards hold. *)
Definition predicate := (pattern * list guard)%type.

Definition same_predicate (q r : predicate) : bool :=
  same_pattern (fst q) (fst r) && all2 same_guard (snd q) (snd r).

Lemma same_predicate_eq : forall q r, same_predicate q r = true -> q = r.
Proof.
  intros [p g] [p' g'] E. apply andb_true_iff in E as [E E']. simpl in *. apply same_pattern_eq in E as ->. f_equal.
  eapply all2_eq; [| exact E']. apply Forall_forall. intros h _. apply same_guard_eq.
Qed.

Definition meets (q : predicate) (e : event) : bool :=
  negb (late e) &&
  existsb (fun bs => forallb (Language.holds (get Nat.eqb bs) no_time) (snd q)) (bindings (fst q) (content e)).

(** The guards of a node that are not constant, and the predicate of its occurrences. *)
Definition own_conditions (t : tree) (n : nat) : list guard := filter (fun g => negb (is_constant g)) (conditions t n).
Definition predicate_of (t : tree) (n : nat) : option predicate :=
  option_map (fun p => (p, own_conditions t n)) (on (node_at t n)).

Fixpoint index (q : predicate) (ps : list predicate) : nat :=
  match ps with [] => 0 | r :: ps => if same_predicate q r then 0 else S (index q ps) end.

(** The number of a predicate in a list; 0 is relevance. *)
Definition number_in (ps : list predicate) (q : predicate) : nat := S (index q ps).

Lemma index_nth : forall q ps, index q ps < length ps -> nth_error ps (index q ps) = Some q.
Proof.
  intros q; induction ps as [| r ps IH]; simpl; intros L; [lia |].
  destruct (same_predicate q r) eqn:E; [apply same_predicate_eq in E; subst; auto |]. apply IH; lia.
Qed.

(** The predicates of a tree, each once, and others that a text uses. *)
Definition tree_predicates (t : tree) (others : list predicate) : list predicate :=
  fold_right (fun q ps => if existsb (same_predicate q) ps then ps else q :: ps) []
    (flat_map (fun n => match predicate_of t n with Some q => [q] | None => [] end) (seq 0 (length (nodes t)))
     ++ others).

Definition satisfies (t : tree) (ps : list predicate) : nat -> event -> bool :=
  let relevant := relevant_event t in
  fun k e => match k with
             | O => relevant e
             | S i => match nth_error ps i with Some q => meets q e | None => false end
             end.

(** ** Plain trees *)

Definition node_variables (t : tree) (n : nat) : list nat :=
  match on (node_at t n) with Some p => pattern_variables p | None => [] end.

(** The guards of a node concern only its own event, or are constant; a variable belongs to one
    occurrence of one node. *)
Definition plain_node (t : tree) (n : nat) : bool :=
  forallb (fun g => is_nil (points g) && forallb (fun x => Conditions.member x (node_variables t n)) (variables g))
    (conditions t n) &&
  (is_nil (node_variables t n) || Nat.leb (times (node_at t n)) 1) &&
  forallb (fun m => Nat.eqb n m ||
      forallb (fun x => negb (Conditions.member x (node_variables t m))) (node_variables t n))
    (seq 0 (length (nodes t))).

Definition plain_tree (t : tree) : bool := basic t && forallb (plain_node t) (seq 0 (length (nodes t))).

Definition covered (t : tree) (ps : list predicate) : bool :=
  forallb (fun n => match predicate_of t n with Some q => Nat.ltb (index q ps) (length ps) | None => true end)
    (seq 0 (length (nodes t))).

Definition shape_of (t : tree) (ps : list predicate) (c : plan event) : shape :=
  Shape (plan_occurrences c) (plan_before c)
    (fun o => match predicate_of t (fst o) with Some q => number_in ps q | None => relevance end).

Definition tree_shapes (t : tree) (w : selection) (ps : list predicate) : list shape :=
  map (shape_of t ps) (plans t w).

Section PlainTree.
Variable t : tree.
Variable ps : list predicate.
Hypothesis well : WellFormed t.
Hypothesis tree_plain : plain_tree t = true.
Hypothesis predicates_covered : covered t ps = true.

Lemma nowhere_outside : forall n, length (nodes t) <= n -> node_at t n = nowhere.
Proof. intros n L. unfold node_at. now rewrite nth_overflow. Qed.

Lemma outside_conditions : forall n, length (nodes t) <= n -> conditions t n = [].
Proof. intros n L. unfold conditions. now rewrite nowhere_outside. Qed.

Lemma tree_basic : basic t = true.
Proof. unfold plain_tree in tree_plain. now apply andb_true_iff in tree_plain. Qed.

Lemma own_guards : forall n g, In g (conditions t n) -> points g = [] /\ incl (variables g) (node_variables t n).
Proof.
  intros n g I. destruct (le_lt_dec (length (nodes t)) n) as [L | L];
    [rewrite outside_conditions in I by auto; destruct I |].
  assert (tp := tree_plain). unfold plain_tree in tp. apply andb_true_iff in tp as [_ tp].
  rewrite forallb_forall in tp.
  assert (P := tp n (proj2 (in_seq _ _ _) (conj (Nat.le_0_l n) L))). unfold plain_node in P.
  rewrite !andb_true_iff in P. destruct P as [[P _] _]. rewrite forallb_forall in P. apply P in I.
  apply andb_true_iff in I as [I J]. rewrite forallb_forall in J. split; [now apply is_nil_iff |].
  intros x X. now apply Conditions.member_iff, J.
Qed.

Lemma variable_private : forall n m x, In x (node_variables t n) -> In x (node_variables t m) ->
  n = m /\ times (node_at t n) <= 1.
Proof.
  intros n m x I J.
  assert (B : forall n, In x (node_variables t n) -> n < length (nodes t)).
  { intros k K. destruct (le_lt_dec (length (nodes t)) k) as [L | L]; auto. unfold node_variables in K.
    rewrite nowhere_outside in K by auto. destruct K. }
  assert (tp := tree_plain). unfold plain_tree in tp. apply andb_true_iff in tp as [_ tp].
  rewrite forallb_forall in tp.
  assert (P := tp n (proj2 (in_seq _ _ _) (conj (Nat.le_0_l n) (B n I)))). unfold plain_node in P.
  rewrite !andb_true_iff in P. destruct P as [[_ T] P]. split.
  - rewrite forallb_forall in P. specialize (P m (proj2 (in_seq _ _ _) (conj (Nat.le_0_l m) (B m J)))).
    apply orb_true_iff in P as [P | P]; [now apply Nat.eqb_eq |]. rewrite forallb_forall in P. apply P in I.
    apply Conditions.member_iff in J. rewrite J in I. discriminate.
  - apply orb_true_iff in T as [T | T]; [apply is_nil_iff in T; rewrite T in I; destruct I | now apply Nat.leb_le].
Qed.

Lemma predicate_numbered : forall n q e, predicate_of t n = Some q -> satisfies t ps (number_in ps q) e = meets q e.
Proof.
  intros n q e P. simpl. rewrite index_nth; auto.
  assert (L : n < length (nodes t)).
  { destruct (le_lt_dec (length (nodes t)) n) as [L | L]; auto. unfold predicate_of in P.
    rewrite nowhere_outside in P by auto. discriminate. }
  unfold covered in predicates_covered. rewrite forallb_forall in predicates_covered.
  specialize (predicates_covered n (proj2 (in_seq _ _ _) (conj (Nat.le_0_l n) L))). rewrite P in predicates_covered.
  now apply Nat.ltb_lt.
Qed.

(** An assignment that is consistent in a plain tree gives each occurrence an event that meets its
    predicate, and the other way round. *)
Lemma plain_consistent : forall r m, Resolution t r -> NoDup (domain m) ->
  (forall o, In o (domain m) -> Occurs t r o) ->
  (forall n g, In n (map fst r) -> In g (conditions t n) -> variables g = [] -> points g = [] ->
     Language.holds (fun _ => Null) (fun _ => None) g = true) ->
  (Consistent t r m <->
   forall o e, In (o, e) m -> exists q, predicate_of t (fst o) = Some q /\ meets q e = true).
Proof.
  intros r m R ND OC CONST. rewrite consistent_basic by exact tree_basic. unfold IsKnown.
  setoid_rewrite (pattern_at_basic t tree_basic). split.
  - intros (a & time & F & _ & G) o e I. destruct (F o e I) as (L & p & O & FP).
    exists (p, own_conditions t (fst o)). unfold predicate_of. rewrite O. split; auto.
    unfold meets. rewrite L. simpl. apply existsb_exists. apply bindings_iff in FP as (bs & J & RS).
    exists bs; split; auto.
    apply forallb_forall. intros g K. apply filter_In in K as [K _]. destruct (own_guards _ _ K) as [PG VG].
    rewrite <- (G (fst o) g); auto.
    + apply holds_same; [| rewrite PG; intros ? []]. intros x X. apply VG in X. unfold node_variables in X.
      rewrite O in X.
      apply (respects_get Nat.eqb Nat.eqb_eq); auto. now apply (bindings_variables p (content e) bs).
    + apply (OC o). apply in_domain; eauto.
    + split; [| rewrite PG; intros ? []]. intros x X. exists o, p. repeat split; auto; [apply in_domain; eauto |].
      apply VG in X. unfold node_variables in X. now rewrite O in X.
  - intros H.
    assert (CH : exists choose : occurrence -> binding nat, forall o e, In (o, e) m ->
       exists p, on (node_at t (fst o)) = Some p /\ late e = false /\ In (choose o) (bindings p (content e)) /\
         forallb (Language.holds (get Nat.eqb (choose o)) no_time) (own_conditions t (fst o)) = true).
    { clear OC. revert ND H. induction m as [| [o e] m IH]; intros ND H; [exists (fun _ => []); intros o e [] |].
      inversion ND as [| ? ? NI ND']; subst. destruct IH as [choose C]; [auto | intros; apply H; simpl; auto |].
      destruct (H o e) as (q & P & M); [simpl; auto |]. unfold predicate_of in P.
      destruct (on (node_at t (fst o))) as [p |] eqn:O; [| discriminate]. injection P as <-.
      unfold meets in M. apply andb_true_iff in M as [L M]. apply existsb_exists in M as (bs & J & M).
      exists (fun x => if same x o then bs else choose x). intros o' e' [Q | I].
      - injection Q as <- <-. rewrite same_refl. exists p. apply negb_true_iff in L. auto.
      - rewrite same_false; auto. intros ->. apply NI. apply in_domain; eauto. }
    destruct CH as [choose CH].
    set (has := fun x (y : occurrence * event) => Conditions.member x (node_variables t (fst (fst y)))).
    set (a := fun x => match find (has x) m with Some y => get Nat.eqb (choose (fst y)) x | None => Null end).
    assert (A : forall o e x, In (o, e) m -> In x (node_variables t (fst o)) -> a x = get Nat.eqb (choose o) x).
    { intros o e x I X. unfold a. destruct (find (has x) m) as [[o' e'] |] eqn:F.
      - apply find_some in F as [J M]. unfold has in M. simpl in M. apply Conditions.member_iff in M.
        destruct (variable_private _ _ _ X M) as [Q T]. f_equal. f_equal.
        assert (O1 : snd o < times (node_at t (fst o))) by (apply (OC o), in_domain; eauto).
        assert (O2 : snd o' < times (node_at t (fst o'))) by (apply (OC o'), in_domain; eauto).
        destruct o as [n i], o' as [n' i']; simpl in *; subst. f_equal. lia.
      - apply (find_none _ _ F) in I. unfold has in I. simpl in I. apply Conditions.member_iff in X. congruence. }
    exists a, (time_at (parts t r) m). repeat split.
    + destruct (CH o e H0) as (p & _ & L & _). exact L.
    + destruct (CH o e H0) as (p & O & L & J & _). exists p; split; auto.
      apply fits_pattern_same with (get Nat.eqb (choose o)).
      * intros x X. symmetry. apply (A o e); auto. unfold node_variables. now rewrite O.
      * apply bindings_iff. exists (choose o); split; auto. now apply (bindings_agree p (content e)).
    + apply time_at_iff; auto. now apply parts_iff.
    + apply time_at_iff; auto. now apply parts_iff.
    + intros n g N I [KV _]. destruct (own_guards _ _ I) as [PG VG]. destruct (variables g) as [| x vs] eqn:V.
      * rewrite (holds_same a (fun _ => Null) _ (fun _ => None));
          [eauto | rewrite V; intros ? [] | rewrite PG; intros ? []].
      * destruct (KV x) as (o & p & D & O & X); [simpl; auto |]. apply in_domain in D as [e D].
        assert (X' : In x (node_variables t (fst o))) by (unfold node_variables; now rewrite O).
        assert (X'' : In x (node_variables t n)) by (apply VG; simpl; auto).
        destruct (variable_private _ _ _ X' X'') as [Q _]. destruct (CH o e D) as (p' & _ & _ & _ & G).
        rewrite forallb_forall in G. rewrite <- (G g).
        -- apply holds_same; [| rewrite PG; intros ? []]. intros y Y. apply (A o e); auto. rewrite Q. apply VG.
           now rewrite <- V.
        -- apply filter_In. rewrite Q. split; auto. unfold is_constant. now rewrite V.
Qed.

Lemma plan_represented : forall w d, In d (plans t w) -> Represents (satisfies t ps) (shape_of t ps d) (denoted d).
Proof.
  intros w d I. assert (SD := plans_sound t w [] d well (basic_absences t tree_basic) I).
  destruct SD as (r & last & R & _ & _ & [_ C] & O & _ & K & _).
  constructor; simpl.
  - tauto.
  - tauto.
  - intros m ND IN. simpl in K. rewrite (K m ND IN), (plain_consistent r m R ND);
      [| intros o J; now apply O, IN | exact C].
    rewrite forallb_forall. split.
    + intros H [o e] J. simpl. destruct (H o e J) as (q & P & M). rewrite P, (predicate_numbered (fst o) q e P).
      exact M.
    + intros H o e J. specialize (H (o, e) J). simpl in H.
      destruct (predicate_of t (fst o)) as [q |] eqn:P.
      * exists q; split; auto. now rewrite (predicate_numbered (fst o) q e P) in H.
      * exfalso. assert (OC : Occurs t r o) by (apply O, IN, in_domain; eauto). destruct OC as (_ & ON & _).
        unfold predicate_of in P. destruct (on (node_at t (fst o))); [discriminate | auto].
  - apply denoted_quiet.
Qed.

(** The shapes of a plain tree represent its scenarios. *)
Theorem tree_represented : forall w, represented (satisfies t ps) (IsScenario t w []) (tree_shapes t w ps).
Proof.
  intros w; split.
  - intros c I. assert (CQ := scenario_quiet t w [] c (basic_absences t tree_basic) I).
    destruct (plans_complete t w [] c well (basic_absences t tree_basic) I) as (d & J & [AO AB AC _]).
    exists (shape_of t ps d).
    split; [now apply in_map |]. destruct (plan_represented w d J) as [SO SP SC _]. constructor.
    + intros o. rewrite (AO o). apply SO.
    + intros p o P O. rewrite <- SP by auto. apply AB; now apply AO, SO.
    + intros m ND IN. rewrite <- SC by auto. apply AC; auto. intros o Q. now apply AO, SO, IN.
    + exact CQ.
  - intros x I. apply in_map_iff in I as (d & <- & I). exists (denoted d).
    split; [apply plans_sound; auto using basic_absences, tree_basic |].
    now apply plan_represented with w.
Qed.

Lemma tree_relevance : forall e, RelevantEvent t e <-> relevant (satisfies t ps) e = true.
Proof. intros e. symmetry. now apply relevant_event_iff. Qed.
End PlainTree.

(** ** The letters of a tree *)

Definition conflict (ps : list predicate) (k l : nat) : bool :=
  match k, l with
  | S i, S j =>
    match nth_error ps i, nth_error ps j with Some q, Some r => exclude (fst q) (fst r) | _, _ => false end
  | _, _ => false
  end.

Lemma conflict_sound : forall t ps e k l, conflict ps k l = true -> satisfies t ps k e = true ->
  satisfies t ps l e = true ->
  False.
Proof.
  intros t ps e [| i] [| j] C; try discriminate. simpl in *.
  destruct (nth_error ps i) as [q |]; [| discriminate]. destruct (nth_error ps j) as [r |]; [| discriminate].
  assert (M : forall q, meets q e = true -> exists b, matches b (fst q) (content e)).
  { intros q' M. unfold meets in M. apply andb_true_iff in M as [_ M]. apply existsb_exists in M as (bs & I & _).
    assert (F : fits_pattern (get Nat.eqb bs) (fst q') (content e)).
    { apply bindings_iff. exists bs; split; auto. now apply (bindings_agree (fst q') (content e)). }
    destruct F as (b & _ & F). eauto. }
  intros A B. destruct (M q A) as [a MA], (M r B) as [b MB]. eapply exclude_sound; eauto.
Qed.

(** The predicates without guards: what relevant events meet. *)
Definition bare (ps : list predicate) (p : pattern) : nat := number_in ps (p, []).

(** The patterns of a letter. *)
Definition patterns_in (ps : list predicate) (a : letter) : list pattern :=
  flat_map (fun k => match k with
                     | O => []
                     | S i => match nth_error ps i with Some q => [fst q] | None => [] end
                     end) a.

(** A letter has each predicate without guards that its patterns imply. *)
Definition closed (ps : list predicate) (a : letter) : bool :=
  match patterns_in ps a with
  | [] => true
  | s => forallb (fun x => negb (is_nil (snd (snd x))) || Automaton.member (S (fst x)) a || negb (implied s (fst (snd
      x))))
                 (combine (seq 0 (length ps)) ps)
  end.

(** A relevant event has one of the patterns of the tree; where nothing is ignored, an event with a
    pattern that has no guard of its own is relevant. *)
Definition plausible (t : tree) (ps : list predicate) : letter -> bool :=
  let guarded := fun i : pattern * option guard => match snd i with Some _ => true | None => false end in
  let patterns := map (fun i => (bare ps (fst i), guarded i)) (Monitor.alphabet t) in
  let known := forallb (fun i => Nat.leb (fst i) (length ps)) patterns in
  let nothing_ignored := is_nil (ignores t) in
  fun a =>
    implb (known && Automaton.member relevance a) (existsb (fun i => Automaton.member (fst i) a) patterns) &&
    implb (nothing_ignored && existsb (fun i => negb (snd i) && Automaton.member (fst i) a) patterns)
      (Automaton.member relevance a) &&
    closed ps a.

Lemma patterns_in_match : forall t ps e p,
  In p (patterns_in ps (letter_of (satisfies t ps) (seq 0 (S (length ps))) e)) ->
  late e = false /\ exists b, matches b p (content e).
Proof.
  intros t ps e p I. apply in_flat_map in I as (k & K & I). unfold letter_of in K. apply filter_In in K as [_ K].
  destruct k as [| i]; [destruct I |]. simpl in K. destruct (nth_error ps i) as [q |]; [| destruct I].
  destruct I as [<- | []]. unfold meets in K. apply andb_true_iff in K as [L K]. split; [now apply negb_true_iff |].
  apply existsb_exists in K as (bs & J & _).
  assert (F : fits_pattern (get Nat.eqb bs) (fst q) (content e)).
  { apply bindings_iff. exists bs; split; auto. now apply (bindings_agree (fst q) (content e)). }
  destruct F as (b & _ & F). eauto.
Qed.

Lemma closed_sound : forall t ps e, closed ps (letter_of (satisfies t ps) (seq 0 (S (length ps))) e) = true.
Proof.
  intros t ps e. set (a := letter_of _ _ e). unfold closed. destruct (patterns_in ps a) as [| p0 s] eqn:P; auto.
  apply forallb_forall. intros [i q] I. simpl.
  apply (combine_seq _ _ (Anything, [])) in I as [I Q]. rewrite Nat.sub_0_r in Q.
  assert (N : nth_error ps i = Some q) by (rewrite Q; apply nth_error_nth'; lia).
  destruct (snd q) as [| g gs] eqn:G; simpl; auto.
  destruct (implied (p0 :: s) (fst q)) eqn:M; [| now rewrite orb_true_r].
  assert (L : i < length ps) by exact (proj2 I).
  assert (IN : In (S i) (seq 0 (S (length ps)))) by (apply in_seq; lia).
  rewrite orb_false_r. unfold a. rewrite member_letter by exact IN. simpl. rewrite N.
  assert (X : forall p, In p (p0 :: s) -> late e = false /\ exists b, matches b p (content e)).
  { intros p J. rewrite <- P in J. now apply patterns_in_match in J. }
  unfold meets. rewrite (proj1 (X p0 (or_introl eq_refl))), G. simpl. apply existsb_exists.
  assert (F : fits_pattern (fun _ => Null) (fst q) (content e)).
  { exists (fun _ => Null). split; auto. apply (implied_sound _ (p0 :: s)); auto. intros p J. now apply X. }
  apply bindings_iff in F as (bs & J & _). exists bs; auto.
Qed.

Lemma satisfies_bare : forall t ps p e, bare ps p <= length ps ->
  satisfies t ps (bare ps p) e = negb (late e) && fits_with p None (content e).
Proof.
  intros t ps p e L. unfold bare, number_in in *. simpl. rewrite index_nth by lia. reflexivity.
Qed.

Lemma plausible_sound : forall t ps e, plausible t ps (letter_of (satisfies t ps) (seq 0 (S (length ps))) e) = true.
Proof.
  intros t ps e. set (a := letter_of _ _ e). unfold plausible. cbv zeta.
  assert (MR : Automaton.member relevance a = relevant_event t e).
  { unfold a. rewrite member_letter by (apply in_seq; unfold relevance; lia). reflexivity. }
  assert (MB : forall p, bare ps p <= length ps ->
    Automaton.member (bare ps p) a = negb (late e) && fits_with p None (content e)).
  { intros p L. unfold a. rewrite member_letter by (apply in_seq; lia). now apply satisfies_bare. }
  assert (MN : forall p, Automaton.member (bare ps p) a = true -> bare ps p <= length ps).
  { intros p M. apply Automaton.member_iff in M. unfold a, letter_of in M. apply filter_In in M as [M _].
    apply in_seq in M. lia. }
  rewrite !andb_true_iff; split; [split | apply closed_sound].
  - rewrite MR. destruct (relevant_event t e) eqn:R; [| now rewrite andb_false_r]. rewrite andb_true_r.
    destruct (forallb _ _) eqn:K; simpl; auto. unfold relevant_event in R. rewrite !andb_true_iff in R.
    destruct R as [[L _] R]. apply existsb_exists in R as ([p g] & I & F). apply existsb_exists.
    exists (bare ps p, match g with Some _ => true | None => false end). split.
    + apply in_map_iff. exists (p, g); auto.
    + rewrite forallb_forall in K. simpl. rewrite MB.
      * rewrite L. simpl. unfold fits_with in *. simpl in F. apply existsb_exists in F as (bs & J & _).
        apply existsb_exists. exists bs; auto.
      * apply Nat.leb_le. apply (K (bare ps p, match g with Some _ => true | None => false end)).
        apply in_map_iff. exists (p, g); auto.
  - rewrite MR. destruct (is_nil (ignores t)) eqn:N; simpl; auto. destruct (existsb _ _) eqn:X; simpl; auto.
    apply existsb_exists in X as (i & I & X). apply in_map_iff in I as ([p g] & <- & I). simpl in X.
    apply andb_true_iff in X as [G X]. destruct g; [discriminate |]. rewrite MB in X by now apply MN.
    apply andb_true_iff in X as [L F]. apply is_nil_iff in N. unfold relevant_event. rewrite L.
    unfold is_ignored. rewrite N. simpl. apply existsb_exists. exists (p, None); auto.
Qed.

Definition tree_letters (t : tree) (ps : list predicate) : list letter :=
  possible_letters (conflict ps) (plausible t ps) (seq 0 (S (length ps))).

Lemma tree_letters_complete : forall t ps e,
  In (letter_of (satisfies t ps) (seq 0 (S (length ps))) e) (tree_letters t ps).
Proof.
  intros t ps e. apply possible_letters_complete; [| apply plausible_sound]. intros k l. apply conflict_sound.
Qed.

(** ** An event for each predicate *)

Fixpoint sample (p : pattern) : value :=
  match p with
  | Exactly v => v
  | Named _ | Anything => Null
  | ObjectWith fields => object (map (fun f => (fst f, sample (snd f))) fields)
  | ListOf items => List (map sample items)
  | SomeItem p => List [sample p]
  end.

(** ** Certificates of trees *)

(** Why no comparison was made. *)
Inductive refusal :=
| NotWellFormed                       (* children do not have greater numbers *)
| NotPlain                            (* variables of several occurrences, or conditions on time *)
| NotTimed                            (* a time point where null is not undefined, or of no occurrence *)
| NotListed                           (* a predicate of the tree is not in the list *)
| NotServed                           (* no event is known that serves some occurrence *)
| NotDetermined                       (* an event may give several values to a variable *)
| NotBound.                           (* no atom of the text binds the variables of some occurrence *)

(** The predicates [ps] are numbered from 1, and 0 is relevance. *)
Definition checked (t : tree) (ps : list predicate) (compared : unit -> outcome) : refusal + outcome :=
  if negb (well_formed t) then inl NotWellFormed
  else if negb (plain_tree t) then inl NotPlain
  else if negb (covered t ps) then inl NotListed
  else inr (compared tt).

Lemma checked_iff : forall t ps o, checked t ps o = inr Certified ->
  WellFormed t /\ plain_tree t = true /\ covered t ps = true /\ o tt = Certified.
Proof.
  intros t ps o H. unfold checked in H. destruct (well_formed t) eqn:W; [| discriminate].
  destruct (plain_tree t) eqn:P; [| discriminate]. destruct (covered t ps) eqn:C; [| discriminate].
  injection H as H. apply well_formed_iff in W. auto.
Qed.
