(** * Relevance and the other predicates of a tree

    A text may define relevance by predicates of its own.  The letters of [PlainTree.v] are fewer when
    relevance is tied to the predicates that define it, and when a predicate is tied to those that it
    implies.  The certificates over these letters are as sound as those of [PlainTree.v]. *)

Require Import List Bool Arith Lia.
Require Import RVAFT.Values RVAFT.Language RVAFT.Definition RVAFT.Search RVAFT.Conditions RVAFT.Scenarios.
Require Import RVAFT.Monitor.
Require Import RVAFT.Plain RVAFT.Automaton RVAFT.Acceptance RVAFT.Exploration RVAFT.Hoa RVAFT.Ltlf RVAFT.Progression.
Require Import RVAFT.Rml RVAFT.RmlCertificate RVAFT.Letters RVAFT.Validator RVAFT.PlainTree.
Import ListNotations.

(** ** Relevance *)

(** What an event type with its guard requires: an entry of the alphabet, or of [ignore]. *)
Definition entry (i : pattern * option guard) : predicate :=
  (fst i, match snd i with Some g => [g] | None => [] end).

Definition relevance_entries (t : tree) : list predicate := map entry (Monitor.alphabet t) ++ map entry (ignores t).

Definition listed (ps : list predicate) (q : predicate) : bool := Nat.ltb (index q ps) (length ps).

Lemma entry_meets : forall i e, meets (entry i) e = negb (late e) && fits_with (fst i) (snd i) (content e).
Proof.
  intros [p [g |]] e; unfold meets, entry, fits_with; simpl; auto. f_equal.
  induction (bindings p (content e)) as [| bs l IH]; simpl; auto. now rewrite andb_true_r, IH.
Qed.

Lemma listed_numbered : forall t ps q e, listed ps q = true -> satisfies t ps (number_in ps q) e = meets q e.
Proof. intros t ps q e L. apply Nat.ltb_lt in L. simpl. now rewrite index_nth. Qed.

(** An event is relevant when it fits the alphabet and no [ignore]. *)
Definition relates (t : tree) (ps : list predicate) : letter -> bool :=
  let wanted := map (number_in ps) (map entry (Monitor.alphabet t)) in
  let ignored := map (number_in ps) (map entry (ignores t)) in
  let known := forallb (listed ps) (relevance_entries t) in
  fun a => implb known (Bool.eqb (Automaton.member relevance a)
    (existsb (fun k => Automaton.member k a) wanted && negb (existsb (fun k => Automaton.member k a) ignored))).

Section Letter.
Variable t : tree.
Variable ps : list predicate.
Variable e : event.
Notation a := (letter_of (satisfies t ps) (seq 0 (S (length ps))) e).

Lemma member_of : forall k, k <= length ps -> Automaton.member k a = satisfies t ps k e.
Proof. intros k L. apply member_letter, in_seq. lia. Qed.

Lemma member_some : forall l, forallb (listed ps) (map entry l) = true ->
  existsb (fun k => Automaton.member k a) (map (number_in ps) (map entry l)) =
  negb (late e) && existsb (fun i => fits_with (fst i) (snd i) (content e)) l.
Proof.
  induction l as [| i l IH]; cbn [map existsb forallb]; intros H; [now rewrite andb_false_r |].
  apply andb_true_iff in H as [L H]. rewrite IH by exact H.
  assert (K : number_in ps (entry i) <= length ps) by (apply Nat.ltb_lt in L; unfold number_in; lia).
  rewrite member_of, listed_numbered, entry_meets by auto. destruct (late e); auto.
Qed.

Lemma relates_sound : relates t ps a = true.
Proof.
  unfold relates. cbv zeta. destruct (forallb (listed ps) (relevance_entries t)) eqn:K; cbn [implb]; auto.
  unfold relevance_entries in K. rewrite forallb_app in K. apply andb_true_iff in K as [K I].
  rewrite !member_some by auto. rewrite member_of by (unfold relevance; lia). apply eqb_true_iff.
  change (satisfies t ps relevance e) with (relevant_event t e). unfold relevant_event, is_ignored.
  destruct (late e); simpl; auto. apply andb_comm.
Qed.
End Letter.

(** ** Predicates that imply others *)

(** Every value that matches the second pattern matches the first, which has no variables. *)
Fixpoint weaker (q p : pattern) {struct q} : bool :=
  match q, p with
  | Anything, _ => true
  | Exactly v, Exactly w => value_eqb v w
  | ObjectWith fields, ObjectWith others =>
    forallb (fun f => existsb (fun g => text_eqb (fst f) (fst g) && weaker (snd f) (snd g)) others) fields
  | ListOf items, ListOf others => all2 weaker items others
  | SomeItem q, SomeItem p => weaker q p
  | _, _ => false
  end.

Lemma weaker_sound : forall q p a b v, weaker q p = true -> matches a p v -> matches b q v.
Proof.
  induction q as [w | x | | fields IH | items IH | q IH] using pattern_induction; intros p a b v W M; destruct p;
    simpl in W; try discriminate; try exact I.
  - apply value_eqb_iff in W. simpl in *. congruence.
  - apply matches_fields in M as (object & -> & M). exists object; split; auto.
    induction IH as [| [n q] fields H _ IHF]; auto. simpl in W. apply andb_true_iff in W as [W W'].
    split; [| exact (IHF W')].
    apply existsb_exists in W as ([n' p] & J & W). apply andb_true_iff in W as [N W]. apply text_eqb_iff in N.
    simpl in N; subst n'. destruct (M (n, p) J) as (w & F & K). exists w; split; auto. now apply (H p a).
  - destruct M as (l & -> & M). exists l; split; auto. revert l items0 W M.
    induction IH as [| q items H _ IHI]; intros [| w l] [| p others] W M; simpl in W;
      try discriminate; try contradiction; auto.
    apply andb_true_iff in W as [W W']. destruct M as [M M']. split; [now apply (H p a) | now apply (IHI l others)].
  - destruct M as (l & -> & w & J & M). exists l; split; auto. exists w; split; auto. now apply (IH p a).
Qed.

(** Variables are renamed, so that two nodes may use names of their own. *)
Section Renaming.
Variable h : nat -> nat.

Local Notation rename_name := (Conditions.rename_name h).
Local Notation rename_pattern := (Conditions.rename_pattern h).
Local Notation rename_guard := (Conditions.rename_guard h).

Lemma rename_matches : forall b p v, matches b (rename_pattern p) v -> matches (fun x => b (rename_name x)) p v.
Proof.
  intros b p; revert b; induction p as [w | x | | fields IH | items IH | p IH] using pattern_induction; intros b v M;
    simpl in *; auto.
  - destruct M as (object & -> & M). exists object; split; auto.
    induction IH as [| [n p] fields H _ IHF]; auto. simpl in M. destruct M as [(w & F & M) M'].
    split; [| exact (IHF M')].
    exists w; split; [exact F | exact (H b w M)].
  - destruct M as (l & -> & M). exists l; split; auto. revert l M.
    induction IH as [| p items H _ IHI]; intros [| w l] M; simpl in M; auto. destruct M as [M M'].
    split; [exact (H b w M) | exact (IHI l M')].
  - destruct M as (l & -> & w & I & M). exists l; split; auto. exists w; auto.
Qed.

Lemma rename_eval : forall a time g, eval a time (rename_guard g) = eval (fun x => a (h x)) time g.
Proof.
  intros a time; induction g as [v | x | p | o l IH | l r IHl IHr | l r IHl IHr] using guard_induction; simpl; auto.
  - rewrite map_map.
    rewrite (map_ext_in (fun g => eval a time (rename_guard g)) (eval (fun x => a (h x)) time) l); auto.
    intros g I. rewrite Forall_forall in IH. auto.
  - now rewrite IHl, IHr.
  - now rewrite IHl, IHr.
Qed.
End Renaming.

(** ** Variables that stand once *)

(** The variables of a pattern, in the order of their places. *)
Fixpoint places (p : pattern) : list name :=
  match p with
  | Exactly _ | Anything => []
  | Named x => [x]
  | ObjectWith fields => flat_map (fun f => places (snd f)) fields
  | ListOf items => flat_map places items
  | SomeItem p => places p
  end.

Fixpoint blank (p : pattern) : pattern :=
  match p with
  | Exactly v => Exactly v
  | Named _ | Anything => Anything
  | ObjectWith fields => ObjectWith (map (fun f => (fst f, blank (snd f))) fields)
  | ListOf items => ListOf (map blank items)
  | SomeItem p => SomeItem (blank p)
  end.

Fixpoint all_different (l : list name) : bool :=
  match l with [] => true | x :: l => negb (existsb (same_name x) l) && all_different l end.

Lemma all_different_NoDup : forall l, all_different l = true -> NoDup l.
Proof.
  induction l as [| x l IH]; simpl; intros H; constructor; apply andb_true_iff in H as [N H]; auto.
  intros I. apply negb_true_iff in N. rewrite <- not_true_iff_false in N. apply N.
  apply existsb_exists. exists x; split; auto. now apply same_name_iff.
Qed.

Lemma is_nil_joined : forall A (l m : list (list A)), is_nil (Conditions.joined l m) = is_nil l || is_nil m.
Proof. intros A [| x l] m; auto. destruct m as [| y m]; simpl; auto. induction l; auto. Qed.

Lemma blank_ways : forall p v, is_nil (ways (blank p) v) = is_nil (ways p v).
Proof.
  induction p as [w | x | | fields IH | items IH | p IH] using pattern_induction; intros v; auto.
  - cbn [blank ways]. destruct v as [| | | | | object |]; auto.
    induction IH as [| [f p] fields H _ IHf]; auto. cbn [map fst snd]. destruct (field f object) as [w |]; auto.
    specialize (H w). cbn [snd] in H.
    destruct (ways (blank p) w) as [| a l], (ways p w) as [| b m]; try discriminate; auto.
    etransitivity; [apply is_nil_joined |]. symmetry. etransitivity; [apply is_nil_joined |]. symmetry. exact IHf.
  - cbn [blank ways]. destruct v as [| | | | list | |]; auto. revert list.
    induction IH as [| p items H _ IHi]; intros [| w list]; auto. cbn [map].
    etransitivity; [apply is_nil_joined |]. symmetry. etransitivity; [apply is_nil_joined |]. symmetry.
    f_equal; [apply H | apply IHi].
  - cbn [blank ways]. destruct v as [| | | | list | |]; auto. induction list as [| w list IHl]; auto. simpl.
    specialize (IH w). destruct (ways (blank p) w), (ways p w); try discriminate; auto.
Qed.

Lemma ways_places : forall p v bs, In bs (ways p v) -> map fst bs = places p.
Proof.
  induction p as [w | x | | fields IH | items IH | p IH] using pattern_induction; intros v bs I.
  - simpl in I. destruct (value_eqb v w); [destruct I as [<- | []]; auto | destruct I].
  - destruct I as [<- | []]; auto.
  - destruct I as [<- | []]; auto.
  - cbn [ways] in I. destruct v as [| | | | | object |]; try destruct I. cbn [places]. revert bs I.
    induction IH as [| [f p] fields H _ IHf]; intros bs I; [destruct I as [<- | []]; auto |].
    destruct (field f object) as [w |]; [| destruct I].
    destruct (ways p w) as [| z l] eqn:W; [destruct I |]. rewrite <- W in I.
    apply in_joined in I as (cs & ds & I & J & ->). rewrite map_app. cbn [flat_map snd]. f_equal; eauto.
  - cbn [ways] in I. destruct v as [| | | | list | |]; try destruct I. cbn [places]. revert list bs I.
    induction IH as [| p items H _ IHi]; intros [| w list] bs I; try destruct I as [<- | []]; try destruct I; auto.
    apply in_joined in I as (cs & ds & I & J & ->). rewrite map_app. cbn [flat_map]. f_equal; eauto.
  - cbn [ways] in I. destruct v as [| | | | list | |]; try destruct I. apply in_flat_map in I as (w & I & J). eauto.
Qed.

Lemma different_agree : forall bs : binding name, NoDup (map fst bs) -> Conditions.agree same_name bs = true.
Proof.
  intros bs N. apply agree_respects. intros x v I. unfold get.
  assert (L : lookup same_name bs x = Some v); [| now rewrite L].
  induction bs as [| [y w] bs IH]; [destruct I |]. inversion N as [| ? ? NI N']; subst. simpl. destruct I as [I | I].
  - injection I as -> ->. now rewrite (proj2 (same_name_iff x x) eq_refl).
  - destruct (same_name x y) eqn:S; auto. apply same_name_iff in S. subst. exfalso. apply NI.
    apply (in_map fst) in I. exact I.
Qed.

(** Variables that stand once match any value. *)
Lemma blank_sound : forall p b v, all_different (places p) = true -> matches b (blank p) v -> bindings p v <> [].
Proof.
  intros p b v D M. apply ways_iff in M as (bs & I & _).
  assert (N : is_nil (ways (blank p) v) = false) by (destruct (ways (blank p) v); [destruct I | auto]).
  rewrite blank_ways in N. destruct (ways p v) as [| cs l] eqn:W; [discriminate |].
  assert (J : In cs (ways p v)) by (rewrite W; simpl; auto). intros Q.
  assert (K : In (rigid cs) (bindings p v)); [| rewrite Q in K; destruct K].
  apply in_distinct, in_map, filter_In. split; auto. apply different_agree. rewrite (ways_places _ _ _ J).
  now apply all_different_NoDup.
Qed.

(** A guard without variables has one value. *)
Definition constantly (b : bool) (g : guard) : bool :=
  is_constant g && Bool.eqb b (Language.holds (fun _ => Null) no_time g).

Lemma constantly_holds : forall b g a, constantly b g = true -> Language.holds a no_time g = b.
Proof.
  intros b g a H. unfold constantly, is_constant in H. rewrite !andb_true_iff in H. destruct H as [[V P] H].
  apply is_nil_iff in V. apply is_nil_iff in P. apply eqb_prop in H. rewrite H.
  apply holds_same; [rewrite V | rewrite P]; intros ? [].
Qed.

Definition never (q : predicate) : bool := existsb (constantly false) (snd q).

Lemma never_sound : forall q e, never q = true -> meets q e = false.
Proof.
  intros [p gs] e N. apply existsb_exists in N as (g & I & N). apply not_true_is_false. intros M.
  unfold meets in M. apply andb_true_iff in M as [_ M]. apply existsb_exists in M as (bs & _ & M).
  rewrite forallb_forall in M. apply M in I. rewrite (constantly_holds false) in I by exact N. discriminate.
Qed.

Fixpoint look_up (x : nat) (pairs : list (nat * nat)) : nat :=
  match pairs with [] => x | (y, z) :: pairs => if Nat.eqb x y then z else look_up x pairs end.

(** The second predicate follows from the first, after its variables are renamed. *)
Definition implies (q r : predicate) : bool :=
  (is_nil (snd r) && all_different (places (fst r)) && weaker (blank (fst r)) (fst q)) ||
  let h := fun x => look_up x (combine (pattern_variables (fst r)) (pattern_variables (fst q))) in
  let p := rename_pattern h (fst r) in
  (same_pattern (fst q) p || weaker p (fst q)) &&
  forallb (fun g => is_nil (points g) &&
    forallb (fun x => Conditions.member x (pattern_variables (fst r))) (variables g) &&
    (constantly true g || existsb (fun g' => same_guard g' (rename_guard h g)) (snd q))) (snd r).

Lemma implies_sound : forall q r e, implies q r = true -> meets q e = true -> meets r e = true.
Proof.
  intros [p gs] [p' gs'] e H M. unfold implies in H. cbv zeta in H. cbn [fst snd] in H.
  apply orb_true_iff in H as [H | H].
  { rewrite !andb_true_iff in H. destruct H as [[N D] H]. apply is_nil_iff in N. subst gs'.
    unfold meets in *. cbn [fst snd forallb] in *. apply andb_true_iff in M as [-> M]. simpl.
    apply existsb_exists in M as (bs & I & _).
    assert (F : fits_pattern (get Nat.eqb bs) p (content e)).
    { apply bindings_iff. exists bs; split; auto. now apply (bindings_agree p (content e)). }
    destruct F as (b & _ & F). apply (weaker_sound _ _ b b _ H), (blank_sound p' b (content e) D) in F.
    destruct (bindings p' (content e)); [congruence | reflexivity]. }
  set (h := fun x => look_up x _) in H.
  apply andb_true_iff in H as [H G]. rewrite forallb_forall in G.
  unfold meets in *. cbn [fst snd] in *. apply andb_true_iff in M as [L M]. rewrite L. cbn [andb].
  apply existsb_exists in M as (bs & I & M). rewrite forallb_forall in M.
  assert (F : fits_pattern (get Nat.eqb bs) p (content e)).
  { apply bindings_iff. exists bs; split; auto. now apply (bindings_agree p (content e)). }
  destruct F as (b & A & F).
  assert (F' : matches b (rename_pattern h p') (content e)).
  { apply orb_true_iff in H as [H | H]; [apply same_pattern_eq in H; now rewrite <- H |].
    now apply (weaker_sound _ p b). }
  apply rename_matches in F'.
  assert (F'' : fits_pattern (fun x => get Nat.eqb bs (h x)) p' (content e)).
  { exists (fun x => b (rename_name h x)); split; auto. intros x. apply A. }
  apply bindings_iff in F'' as (cs & J & R). apply existsb_exists. exists cs; split; auto.
  apply forallb_forall. intros g K. apply G in K. rewrite !andb_true_iff in K. destruct K as [[P V] K].
  apply is_nil_iff in P. rewrite forallb_forall in V. apply orb_true_iff in K as [K | K];
    [now apply constantly_holds |].
  apply existsb_exists in K as (g' & K & Q). apply same_guard_eq in Q; subst g'. apply M in K. rewrite <- K.
  unfold Language.holds at 2. rewrite rename_eval. apply holds_same; [| rewrite P; intros ? []].
  intros x X. apply (respects_get Nat.eqb Nat.eqb_eq _ _ _ R). apply (bindings_variables p' (content e)); auto.
  now apply Conditions.member_iff, V.
Qed.

(** The pairs of numbers of predicates of which the first implies the second. *)
Definition implications (ps : list predicate) : list (nat * nat) :=
  flat_map (fun q => flat_map (fun r =>
    if implies q r && listed ps q && listed ps r then [(number_in ps q, number_in ps r)] else []) ps) ps.

Definition follows (ps : list predicate) : letter -> bool :=
  let pairs := implications ps in
  let impossible := map (number_in ps) (filter (fun q => never q && listed ps q) ps) in
  fun a => forallb (fun kl => implb (Automaton.member (fst kl) a) (Automaton.member (snd kl) a)) pairs &&
           forallb (fun k => negb (Automaton.member k a)) impossible.

Lemma follows_sound : forall t ps e, follows ps (letter_of (satisfies t ps) (seq 0 (S (length ps))) e) = true.
Proof.
  intros t ps e.
  assert (B : forall q, listed ps q = true -> number_in ps q <= length ps)
    by (intros s L; apply Nat.ltb_lt in L; unfold number_in; lia).
  apply andb_true_iff; split; apply forallb_forall.
  - intros [k l] I. apply in_flat_map in I as (q & _ & I).
    apply in_flat_map in I as (r & _ & I). destruct (implies q r && listed ps q && listed ps r) eqn:H; [| destruct I].
    destruct I as [I | []]. injection I as <- <-. rewrite !andb_true_iff in H. destruct H as [[H Q] R].
    simpl fst. simpl snd. rewrite !member_of, !listed_numbered by auto.
    destruct (meets q e) eqn:M; auto. simpl. now apply (implies_sound q r).
  - intros k I. apply in_map_iff in I as (q & <- & I). apply filter_In in I as [_ I].
    apply andb_true_iff in I as [N L]. rewrite member_of, listed_numbered by auto. now rewrite never_sound.
Qed.

(** ** Certificates over fewer letters *)

Definition related_letters (t : tree) (ps : list predicate) : list letter :=
  let relates := relates t ps in
  let follows := follows ps in
  filter (fun a => relates a && follows a) (tree_letters t ps).

Lemma related_letters_complete : forall t ps e,
  In (letter_of (satisfies t ps) (seq 0 (S (length ps))) e) (related_letters t ps).
Proof.
  intros t ps e. apply filter_In. split; [apply tree_letters_complete |]. now rewrite relates_sound, follows_sound.
Qed.

(** The predicates of a tree, of its relevance, and of a text, each once. *)
Definition text_predicates (t : tree) (others : list predicate) : list predicate :=
  tree_predicates t (relevance_entries t ++ others).

Definition certify_text_rml (mix : mixing) (t : tree) (w : selection) (s : semantics) (ps : list predicate)
  (fuel depth : nat) (equations : list term) (x : term) : refusal + outcome :=
  checked t ps
    (fun _ =>
      certify_rml mix s (tree_shapes t w ps) (seq 0 (S (length ps))) (related_letters t ps) fuel depth equations x).

(** A certified text of RML has the verdict of the tree on every trace. *)
Theorem certify_text_rml_correct : forall mix t w s ps fuel depth equations x,
  certify_text_rml mix t w s ps fuel depth equations x = inr Certified ->
  forall u v, RmlVerdict equations x (valuations (satisfies t ps) u) v <-> VerdictOfTree t w s u v.
Proof.
  intros mix t w s ps fuel depth equations x H. apply checked_iff in H as (W & P & C & H).
  eapply certified_rml; eauto using tree_relevance, tree_represented, related_letters_complete.
Qed.
