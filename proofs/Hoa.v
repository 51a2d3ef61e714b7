(** * Automata in HOA

    A text of HOA is a Büchi automaton over infinite words.  A finite word is encoded as by Spot's
    [from_ltlf]: the proposition [alive] holds during the word and not after it; after it, no
    proposition holds.  A deterministic text is certified against plain scenarios. *)

Require Import List Bool Arith Lia.
Require Import RVAFT.Language RVAFT.Definition RVAFT.Search RVAFT.Plain RVAFT.Automaton RVAFT.Acceptance
  RVAFT.Exploration.
Import ListNotations.

(** ** Texts and what they accept *)

(** A label is a Boolean formula over propositions: [alive], and numbered predicates on events. *)
Inductive label :=
| AnyLetter
| Alive
| Proposition (p : nat)
| NotLabel (l : label)
| BothLabels (l m : label)
| EitherLabel (l m : label).

(** States are numbered.  Each has edges with a label and a target, and is marked (acceptance set 0) or not. *)
Record hoa := Hoa { start_state : nat; edges : list (list (label * nat)); marks : list bool }.

(** At a position of the infinite word: the predicates that hold there, or [None] after the end. *)
Fixpoint reads (at_position : option (nat -> bool)) (l : label) : bool :=
  match l with
  | AnyLetter => true
  | Alive => match at_position with Some _ => true | None => false end
  | Proposition p => match at_position with Some holds => holds p | None => false end
  | NotLabel l => negb (reads at_position l)
  | BothLabels l m => reads at_position l && reads at_position m
  | EitherLabel l m => reads at_position l || reads at_position m
  end.

Definition edges_of (h : hoa) (q : nat) : list (label * nat) := nth q (edges h) [].
Definition marked (h : hoa) (q : nat) : bool := nth q (marks h) false.

Definition Edge (h : hoa) (at_position : option (nat -> bool)) (q r : nat) : Prop :=
  exists l, In (l, r) (edges_of h q) /\ reads at_position l = true.

(** A run of the automaton on the infinite word of a finite one; it accepts when it visits marked
    states again and again. *)
Definition Run (h : hoa) (word : list (nat -> bool)) (run : nat -> nat) : Prop :=
  run 0 = start_state h /\ forall i, Edge h (nth_error word i) (run i) (run (S i)).

Definition HoaAccepts (h : hoa) (word : list (nat -> bool)) : Prop :=
  exists run, Run h word run /\ forall i, exists j, i <= j /\ marked h (run j) = true.

(** ** Deterministic texts *)

Definition enabled (row : list (label * nat)) (at_position : option (nat -> bool)) : list (label * nat) :=
  filter (fun edge => reads at_position (fst edge)) row.

(** The only target, or [None] without one.  The second component says whether it is the only one. *)
Definition target (row : list (label * nat)) (at_position : option (nat -> bool)) : option nat * bool :=
  match enabled row at_position with
  | [] => (None, true)
  | (_, r) :: others => (Some r, forallb (fun edge => Nat.eqb (snd edge) r) others)
  end.

(** A state of the text as the certifier has it: after a word that stays unambiguous, the state, or
    [None] when the run is stuck. *)
Inductive position := Standing (q : option nat) | Ambiguous.

Definition hoa_next (row : list (label * nat)) (a : letter) : position :=
  match target row (Some (predicates_of a)) with (r, true) => Standing r | (_, false) => Ambiguous end.

Definition hoa_step (h : hoa) (q : position) (a : letter) : position :=
  match q with
  | Standing (Some q) => hoa_next (edges_of h q) a
  | Standing None => Standing None
  | Ambiguous => Ambiguous
  end.

Definition hoa_moves (h : hoa) (q : position) (possible : list letter) : list position :=
  match q with
  | Standing (Some q) => let row := edges_of h q in map (hoa_next row) possible
  | Standing None => map (fun _ => Standing None) possible
  | Ambiguous => map (fun _ => Ambiguous) possible
  end.

(** What is accepted when the word ends in a state: it must lead, unambiguously, to a state that it
    does not leave, or get stuck. *)
Fixpoint hoa_ending (h : hoa) (fuel : nat) (q : nat) : option bool :=
  match fuel with
  | O => None
  | S fuel =>
    match target (edges_of h q) None with
    | (None, _) => Some false
    | (Some r, true) => if Nat.eqb q r then Some (marked h q) else hoa_ending h fuel r
    | (Some _, false) => None
    end
  end.

Definition hoa_accepts (h : hoa) (q : position) : option bool :=
  match q with
  | Standing (Some q) => hoa_ending h (S (length (edges h))) q
  | Standing None => Some false
  | Ambiguous => None
  end.

(** ** The deterministic reading is the meaning of the text *)

Lemma target_edge : forall h q at_position r, target (edges_of h q) at_position = (r, true) ->
  forall r', Edge h at_position q r' <-> r = Some r'.
Proof.
  intros h q at_position r T r'. unfold target in T.
  assert (F : Edge h at_position q r' <-> exists l, In (l, r') (enabled (edges_of h q) at_position)).
  { unfold Edge, enabled. split; intros (l & I); exists l; rewrite filter_In in *; auto. }
  rewrite F. destruct (enabled (edges_of h q) at_position) as [| [l0 r0] others].
  - injection T as <-. split; [intros (l & []) | discriminate].
  - injection T as <- A. rewrite forallb_forall in A. split.
    + intros (l & [Q | I]); [congruence |]. apply A in I. simpl in I. apply Nat.eqb_eq in I. congruence.
    + intros Q; injection Q as ->. exists l0; simpl; auto.
Qed.

Lemma hoa_step_edge : forall h q a r, hoa_step h (Standing (Some q)) a = Standing r ->
  forall r', Edge h (Some (predicates_of a)) q r' <-> r = Some r'.
Proof.
  intros h q a r. simpl. unfold hoa_next. destruct (target _ _) as [r0 []] eqn:T; [| discriminate].
  intros Q; injection Q as ->. now apply target_edge.
Qed.

Definition after (h : hoa) (word : list letter) : position :=
  fold_left (hoa_step h) word (Standing (Some (start_state h))).

Lemma ambiguous_stays : forall h word, fold_left (hoa_step h) word Ambiguous = Ambiguous.
Proof. induction word; simpl; auto. Qed.

Lemma stuck_stays : forall h word, fold_left (hoa_step h) word (Standing None) = Standing None.
Proof. induction word; simpl; auto. Qed.

(** A run has no choice during the word. *)
Lemma run_during : forall h word q run, fold_left (hoa_step h) word (Standing (Some q)) <> Ambiguous -> run 0 = q ->
  (forall i, i < length word -> Edge h (nth_error (word_of word) i) (run i) (run (S i))) ->
  fold_left (hoa_step h) word (Standing (Some q)) = Standing (Some (run (length word))).
Proof.
  intros h; induction word as [| a word IH]; intros q run N Z R; [simpl; congruence |].
  cbn [fold_left] in *.
  destruct (hoa_step h (Standing (Some q)) a) as [r |] eqn:S; [| now rewrite ambiguous_stays in N].
  assert (E : Edge h (Some (predicates_of a)) (run 0) (run 1)) by (apply (R 0); simpl; lia).
  rewrite Z in E. rewrite (hoa_step_edge _ _ _ _ S) in E. subst r.
  rewrite (IH (run 1) (fun i => run (Datatypes.S i))); auto. intros i L. apply (R (Datatypes.S i)). simpl; lia.
Qed.

(** The run during the word, from a state that it reaches. *)
Lemma run_exists : forall h word q r, fold_left (hoa_step h) word (Standing (Some q)) = Standing (Some r) ->
  exists run, run 0 = q /\ run (length word) = r /\
    forall i, i < length word -> Edge h (nth_error (word_of word) i) (run i) (run (S i)).
Proof.
  intros h; induction word as [| a word IH]; intros q r H.
  - injection H as ->. exists (fun _ => r); repeat split; auto. simpl; lia.
  - cbn [fold_left] in H. destruct (hoa_step h (Standing (Some q)) a) as [[q' |] |] eqn:S.
    + destruct (IH q' r H) as (run & Z & L & R). exists (fun i => match i with O => q | Datatypes.S i => run i end).
      repeat split; auto. intros [| i] I; simpl in *.
      * rewrite Z. apply (hoa_step_edge _ _ _ _ S); auto.
      * apply R; lia.
    + now rewrite stuck_stays in H.
    + now rewrite ambiguous_stays in H.
Qed.

(** After the word: whether the continuation without propositions is accepted from a state. *)
Definition EndAccepts (h : hoa) (q : nat) : Prop :=
  exists run, run 0 = q /\ (forall i, Edge h None (run i) (run (S i))) /\
    forall i, exists j, i <= j /\ marked h (run j) = true.

Lemma hoa_ending_correct : forall h fuel q b, hoa_ending h fuel q = Some b -> (b = true <-> EndAccepts h q).
Proof.
  intros h; induction fuel as [| fuel IH]; simpl; [discriminate |]. intros q b H.
  destruct (target (edges_of h q) None) as [[r |] sure] eqn:T; [destruct sure |].
  - pose proof (target_edge _ _ _ _ T) as D. destruct (Nat.eqb_spec q r) as [<- | N].
    + injection H as <-. split.
      * intros M. exists (fun _ => q); repeat split; auto.
        -- intros _. now apply D.
        -- intros i; exists i; auto.
      * intros (run & Z & R & M).
        assert (forall i, run i = q).
        { induction i as [| i IHi]; auto. specialize (R i). rewrite IHi in R. apply D in R. congruence. }
        destruct (M 0) as (j & _ & J). congruence.
    + apply IH in H. rewrite H. split.
      * intros (run & Z & R & M). exists (fun i => match i with O => q | S i => run i end). repeat split.
        -- intros [| i]; auto. apply D. congruence.
        -- intros [| i]; [destruct (M 0) as (j & _ & J); exists (S j) | destruct (M i) as (j & L & J); exists (S j)];
             split; auto; lia.
      * intros (run & Z & R & M). exists (fun i => run (S i)). repeat split.
        -- specialize (R 0). rewrite Z in R. apply D in R. congruence.
        -- intros i; apply R.
        -- intros i. destruct (M (S i)) as ([| j] & L & J); [lia |]. exists j; split; auto; lia.
  - discriminate.
  - injection H as <-. split; [discriminate |]. intros (run & Z & R & _). specialize (R 0). rewrite Z in R.
    assert (sure = true) by (unfold target in T; destruct (enabled _ _) as [| [? ?] ?]; congruence). subst sure.
    apply (target_edge _ _ _ _ T) in R. discriminate.
Qed.

(** The deterministic reading of a text that stays unambiguous is its meaning. *)
Theorem hoa_reading : forall h word b, hoa_accepts h (after h word) = Some b ->
  (b = true <-> HoaAccepts h (word_of word)).
Proof.
  intros h word b H. unfold after in H.
  assert (NA : fold_left (hoa_step h) word (Standing (Some (start_state h))) <> Ambiguous)
    by (intros Q; rewrite Q in H; discriminate).
  assert (LW : length (word_of word) = length word) by apply map_length.
  assert (END : forall run q, Run h (word_of word) run -> run (length word) = q ->
    (forall i, exists j, i <= j /\ marked h (run j) = true) -> EndAccepts h q).
  { intros run q [_ R] Q M. exists (fun i => run (i + length word)). split; [exact Q |]. split.
    - intros i. specialize (R (i + length word)). rewrite (proj2 (nth_error_None _ _)) in R by lia. exact R.
    - intros i. destruct (M (i + length word)) as (j & L & J). exists (j - length word). split; [lia |].
      replace (j - length word + length word) with j by lia; auto. }
  assert (DURING : forall run, Run h (word_of word) run ->
    fold_left (hoa_step h) word (Standing (Some (start_state h))) = Standing (Some (run (length word)))).
  { intros run [Z R]. apply run_during; auto. }
  destruct (fold_left (hoa_step h) word (Standing (Some (start_state h)))) as [[q |] |] eqn:F; [| |congruence].
  - simpl in H. change (hoa_ending h (S (length (edges h))) q = Some b) in H. apply hoa_ending_correct in H. rewrite H.
    split.
    + intros (tail & Z & R & M). destruct (run_exists _ _ _ _ F) as (run & Z' & L & R').
      exists (fun i => if i <? length word then run i else tail (i - length word)). split; [split |].
      * destruct (Nat.ltb_spec 0 (length word)); auto. replace (length word) with 0 in * by lia. simpl. congruence.
      * intros i. destruct (Nat.ltb_spec i (length word)) as [I | I].
        -- specialize (R' i I). destruct (Nat.ltb_spec (S i) (length word)); auto.
           assert (S i = length word) as Q by lia. rewrite Q, Nat.sub_diag, Z. rewrite Q, L in R'. exact R'.
        -- rewrite (proj2 (nth_error_None _ _)) by lia. destruct (Nat.ltb_spec (S i) (length word)); [lia |].
           replace (S i - length word) with (S (i - length word)) by lia. apply R.
      * intros i. destruct (M i) as (j & J & K). exists (j + length word). split; [lia |].
        destruct (Nat.ltb_spec (j + length word) (length word)); [lia |].
        replace (j + length word - length word) with j by lia. exact K.
    + intros (run & R & M). specialize (DURING run R). injection DURING as D. eapply END; eauto.
  - injection H as <-. split; [discriminate |]. intros (run & R & _). specialize (DURING run R). discriminate.
Qed.

(** ** The certificate *)

Fixpoint label_atoms (l : label) : list nat :=
  match l with
  | AnyLetter | Alive => []
  | Proposition p => [p]
  | NotLabel l => label_atoms l
  | BothLabels l m | EitherLabel l m => label_atoms l ++ label_atoms m
  end.

Definition hoa_atoms (h : hoa) : list nat := flat_map (flat_map (fun edge => label_atoms (fst edge))) (edges h).

Definition same_position (q r : position) : bool :=
  match q, r with
  | Standing (Some q), Standing (Some r) => Nat.eqb q r
  | Standing None, Standing None => true
  | Ambiguous, Ambiguous => true
  | _, _ => false
  end.

Definition hash_position (q : position) : nat := match q with Standing (Some q) => S q | _ => 0 end.

(** The predicates are those of the scenarios and of the text; the possible letters are over these. *)
Definition certify_hoa (mix : mixing) (s : semantics) (xs : list shape) (predicates : list nat) (possible : list letter)
  (fuel : nat) (h : hoa) : outcome :=
  if all_among (alphabet xs) predicates && all_among (hoa_atoms h) predicates
  then compare_with_automaton mix same_position hash_position (hoa_moves h) (fun q => accepts_alike (hoa_accepts h q)) s
         (map rows xs) possible fuel (Standing (Some (start_state h)))
  else Exhausted.

Lemma same_position_iff : forall q r, same_position q r = true <-> q = r.
Proof.
  intros [[q |] |] [[r |] |]; simpl; try (split; congruence). rewrite Nat.eqb_eq. split; congruence.
Qed.

Lemma hoa_moves_map : forall h q l, hoa_moves h q l = map (hoa_step h q) l.
Proof. intros h [[q |] |] l; reflexivity. Qed.

Lemma reads_agree : forall l v w, (forall p, In p (label_atoms l) -> v p = w p) -> reads (Some v) l = reads (Some w) l.
Proof.
  induction l as [| | p | l IH | l IHl m IHm | l IHl m IHm]; simpl; intros v w H; auto.
  - erewrite IH; eauto.
  - erewrite IHl, IHm; auto; intros; apply H, in_app_iff; auto.
  - erewrite IHl, IHm; auto; intros; apply H, in_app_iff; auto.
Qed.

Lemma edge_agree : forall h v w q r, (forall p, In p (hoa_atoms h) -> v p = w p) ->
  Edge h (Some v) q r -> Edge h (Some w) q r.
Proof.
  intros h v w q r H (l & I & R). exists l; split; auto. rewrite <- R. apply reads_agree. intros p J. symmetry. apply H.
  apply in_flat_map. exists (edges_of h q). split.
  - unfold edges_of in *. destruct (lt_dec q (length (edges h))); [now apply nth_In |].
    rewrite nth_overflow in I by lia. destruct I.
  - apply in_flat_map. exists (l, r); auto.
Qed.

Lemma accepts_agree : forall h u w, length u = length w ->
  (forall i v v', nth_error u i = Some v -> nth_error w i = Some v' -> forall p, In p (hoa_atoms h) -> v p = v' p) ->
  HoaAccepts h u -> HoaAccepts h w.
Proof.
  intros h u w L H (run & [Z R] & M). exists run; split; auto. split; auto. intros i. specialize (R i).
  destruct (nth_error u i) as [v |] eqn:U, (nth_error w i) as [v' |] eqn:W; auto.
  - apply edge_agree with v; auto. eauto.
  - apply nth_error_None in W. assert (i < length u) by (apply nth_error_Some; congruence). lia.
  - apply nth_error_None in U. assert (i < length w) by (apply nth_error_Some; congruence). lia.
Qed.

Section Certificate.
Context {E : Type}.
Variable satisfies : nat -> E -> bool.
Notation relevant := (relevant satisfies).
Notation Rel := (fun e => relevant e = true).
Notation plain := (plain satisfies).

Notation valuations := (valuations satisfies).

Lemma accepts_letters : forall h predicates u, incl (hoa_atoms h) predicates ->
  (HoaAccepts h (word_of (letters satisfies predicates u)) <-> HoaAccepts h (valuations u)).
Proof.
  intros h ps u A.
  assert (L : length (word_of (letters satisfies ps u)) = length (valuations u))
    by (unfold word_of, letters, valuations; now rewrite !map_length).
  assert (X : forall i v v', nth_error (word_of (letters satisfies ps u)) i = Some v ->
    nth_error (valuations u) i = Some v' ->
     forall p, In p (hoa_atoms h) -> v p = v' p).
  { intros i v v' V V' p I. unfold word_of, letters in V. rewrite map_map in V. unfold valuations in V'.
    rewrite nth_error_map in V, V'. destruct (nth_error u i) as [e |]; [| discriminate]. injection V as <-.
    injection V' as <-.
    unfold predicates_of. apply member_letter; auto. }
  split; apply accepts_agree; auto. intros i v v' V V' p I. symmetry. eauto.
Qed.

(** A certified text accepts exactly the traces with a detection. *)
Theorem certify_hoa_language : forall mix s xs predicates possible fuel h,
  certify_hoa mix s xs predicates possible fuel h = Certified ->
  (forall e, In (letter_of satisfies predicates e) possible) ->
  forall u, HoaAccepts h (valuations u) <-> Detected Rel (Scenarios (map plain xs)) s u.
Proof.
  intros mix s xs ps possible fuel h C P u. unfold certify_hoa in C.
  destruct (all_among (alphabet xs) ps && all_among (hoa_atoms h) ps) eqn:A; [| discriminate].
  apply andb_true_iff in A as [A B]. apply all_among_incl in A, B.
  assert (F : Forall (fun l => In l possible) (letters satisfies ps u)).
  { apply Forall_forall. intros l I. apply in_map_iff in I as (e & <- & _). auto. }
  pose proof (compare_sound mix same_position hash_position (hoa_moves h) (hoa_step h) _ same_position_iff
    (hoa_moves_map h) s (map rows xs) possible fuel _ C _ F) as K.
  apply accepts_alike_iff in K. fold (after h (letters satisfies ps u)) in K. apply hoa_reading in K.
  rewrite <- accepts_letters with (predicates := ps), <- K by auto.
  rewrite <- automaton_accepts with (predicates := ps).
  - fold (automaton_after satisfies ps s xs u).
    destruct (automaton_after satisfies ps s xs u); simpl; split; congruence.
  - apply A; simpl; auto.
  - apply Forall_forall. intros x I p J. apply A. right. apply in_flat_map; eauto.
Qed.
End Certificate.
