(** * Exploration of a deterministic text beside the automaton

    A text is certified by visiting all pairs of a state of the text and a state of the automaton of
    [Automaton.v], and comparing what they accept.  The visited pairs are kept in a search tree by
    hash.  The search is bounded: when it runs out, nothing is certified. *)

Require Import List Bool Arith Lia.
Require Import RVAFT.Language RVAFT.Definition RVAFT.Search RVAFT.Plain RVAFT.Automaton.
Import ListNotations.

(** ** Exploring a graph *)

Inductive outcome :=
| Certified
| Refuted (word : list letter)
| Exhausted.

Section Exploration.
Context {S : Type}.
Variable same_state : S -> S -> bool.
Variable hash : S -> nat.
Hypothesis same_state_iff : forall a b, same_state a b = true <-> a = b.

Inductive store := Vacant | Stored (smaller : store) (key : nat) (kept : S) (others : store).

Fixpoint stored (key : nat) (a : S) (t : store) : bool :=
  match t with
  | Vacant => false
  | Stored l k b r =>
    match Nat.compare key k with
    | Lt => stored key a l
    | Gt => stored key a r
    | Eq => same_state a b || stored key a r
    end
  end.

Fixpoint put_in (key : nat) (a : S) (t : store) : store :=
  match t with
  | Vacant => Stored Vacant key a Vacant
  | Stored l k b r =>
    match Nat.compare key k with
    | Lt => Stored (put_in key a l) k b r
    | Gt | Eq => Stored l k b (put_in key a r)
    end
  end.

Variable moves : S -> list (letter * S).
Variable good : S -> bool.

(** Each state to visit comes with the reversed word that leads to it. *)
Fixpoint explore (fuel : nat) (todo : list (list letter * S)) (seen : store) : outcome :=
  match todo with
  | [] => Certified
  | (word, a) :: todo =>
    match fuel with
    | O => Exhausted
    | Datatypes.S fuel =>
      let key := hash a in
      if stored key a seen then explore fuel todo seen
      else if good a
      then explore fuel (rev_append (map (fun m => (fst m :: word, snd m)) (moves a)) todo) (put_in key a seen)
      else Refuted (rev word)
    end
  end.

Inductive Reachable (from : S) : S -> Prop :=
| reachable_start : Reachable from from
| reachable_move : forall a b l, Reachable from a -> In (l, b) (moves a) -> Reachable from b.

Definition has (t : store) (a : S) : Prop := stored (hash a) a t = true.

Lemma has_put : forall a b t, has (put_in (hash b) b t) a <-> a = b \/ has t a.
Proof.
  unfold has; intros a b; induction t as [| l IHl k c r IHr]; simpl.
  - destruct (Nat.compare_spec (hash a) (hash b)) as [Q | Q | Q].
    + rewrite orb_false_r, same_state_iff. intuition discriminate.
    + split; [discriminate |]. intros [-> | H]; [lia | discriminate].
    + split; [discriminate |]. intros [-> | H]; [lia | discriminate].
  - destruct (Nat.compare_spec (hash b) k) as [Q | Q | Q]; simpl;
      destruct (Nat.compare_spec (hash a) k) as [R | R | R]; rewrite ?orb_true_iff, ?IHl, ?IHr;
      try tauto; (split; [tauto | intros [-> | H]; [exfalso; lia | exact H]]).
Qed.

Definition explored (t : store) (todo : list (list letter * S)) : Prop :=
  forall a, has t a -> good a = true /\ forall l b, In (l, b) (moves a) -> has t b \/ In b (map snd todo).

Lemma explore_certified : forall fuel todo t, explore fuel todo t = Certified -> explored t todo ->
  exists t', explored t' [] /\ (forall a, has t a \/ In a (map snd todo) -> has t' a).
Proof.
  induction fuel as [| fuel IH]; intros [| [word a] todo] t H X; simpl in H; try discriminate.
  - exists t; simpl; split; auto. intros a [K | []]; auto.
  - exists t; simpl; split; auto. intros a [K | []]; auto.
  - destruct (stored (hash a) a t) eqn:M.
    + destruct (IH todo t H) as (t' & X' & K).
      * intros b B. destruct (X b B) as [G N]. split; auto. intros l c J. destruct (N l c J) as [Z | [<- | Z]]; auto.
      * exists t'; split; auto. intros b [B | [<- | B]]; auto.
    + destruct (good a) eqn:G; [| discriminate].
      set (next := rev_append _ todo) in H.
      assert (NX : forall b, In b (map snd next) <-> (exists l, In (l, b) (moves a)) \/ In b (map snd todo)).
      { intros b. unfold next. rewrite rev_append_rev, map_app, in_app_iff, map_rev, <- in_rev, map_map. simpl.
        rewrite in_map_iff. split; (intros [Z | Z]; [left | right; exact Z]).
        - destruct Z as ([l c] & <- & Z). exists l; auto.
        - destruct Z as (l & Z). exists (l, b); auto. }
      destruct (IH next _ H) as (t' & X' & K).
      * intros b B. apply has_put in B as [-> | B].
        -- split; auto. intros l c J. right. apply NX; eauto.
        -- destruct (X b B) as [Gb N]. split; auto. intros l c J. destruct (N l c J) as [Z | [<- | Z]].
           ++ left. apply has_put; auto.
           ++ left. apply has_put; auto.
           ++ right. apply NX; auto.
      * exists t'; split; auto. intros b [B | [<- | B]]; apply K; [left | left | right].
        -- apply has_put; auto.
        -- apply has_put; auto.
        -- apply NX; auto.
Qed.

(** When the exploration is certified, every reachable state is good. *)
Theorem explore_sound : forall fuel a, explore fuel [([], a)] Vacant = Certified ->
  forall b, Reachable a b -> good b = true.
Proof.
  intros fuel a H b R. destruct (explore_certified _ _ _ H) as (t & X & K).
  { intros c C; discriminate. }
  assert (has t b).
  { induction R as [| b c l R IH I]; [apply K; simpl; auto |]. destruct (X b IH) as [_ N].
    destruct (N l c I) as [Z | []]; auto. }
  now apply X.
Qed.
End Exploration.

(** ** A text beside the automaton *)

(** Hashing is left to the caller: [mix] may be any function, and only the speed depends on it. *)
Definition mixing := nat -> nat -> nat.

Definition hash_state (mix : mixing) (q : state) : nat :=
  match q with
  | Accepting => 1
  | Watching sets =>
    let of_done := fun h d => fold_left (fun h o => mix (mix h (fst o)) (snd o)) d (mix h 7) in
    fold_left (fun h ds => fold_left of_done ds (mix h 5)) sets 3
  end.

Fixpoint same_list {A} (equal : A -> A -> bool) (l m : list A) : bool :=
  match l, m with
  | [], [] => true
  | a :: l, b :: m => equal a b && same_list equal l m
  | _, _ => false
  end.

Lemma same_list_iff : forall A (equal : A -> A -> bool), (forall a b, equal a b = true <-> a = b) ->
  forall l m, same_list equal l m = true <-> l = m.
Proof.
  intros A equal H; induction l as [| a l IH]; destruct m as [| b m]; simpl; try (split; congruence).
  rewrite andb_true_iff, H, IH. split; [intros [-> ->]; auto | intros Q; injection Q; auto].
Qed.

Definition same_state_of_automaton (q r : state) : bool :=
  match q, r with
  | Accepting, Accepting => true
  | Watching l, Watching m => same_list (same_list same_done) l m
  | _, _ => false
  end.

Lemma same_state_of_automaton_iff : forall q r, same_state_of_automaton q r = true <-> q = r.
Proof.
  intros [| l] [| m]; simpl; try (split; congruence).
  rewrite same_list_iff by (apply same_list_iff, same_done_iff). split; congruence.
Qed.

Section Text.
(** A deterministic text: its states, their moves for some letters, and whether a state fits a state of
    the automaton. *)
Context {T : Type}.
Variable mix : mixing.
Variable same_text : T -> T -> bool.
Variable hash_text : T -> nat.
Variable text_moves : T -> list letter -> list T.
Variable text_step : T -> letter -> T.
Variable fits : T -> state -> bool.
Hypothesis same_text_iff : forall a b, same_text a b = true <-> a = b.
Hypothesis text_moves_map : forall t l, text_moves t l = map (text_step t) l.

Variable s : semantics.
Variable tables : list (list row).
Variable possible : list letter.

Definition same_pair (a b : T * state) : bool := same_text (fst a) (fst b) && same_state_of_automaton (snd a) (snd b).
Definition hash_pair (a : T * state) : nat := mix (hash_text (fst a)) (hash_state mix (snd a)).
Definition pair_moves (a : T * state) : list (letter * (T * state)) :=
  map2 (fun l t => (l, (t, delta s tables (snd a) l))) possible (text_moves (fst a) possible).
Definition pair_good (a : T * state) : bool := fits (fst a) (snd a).

Definition compare_with_automaton (fuel : nat) (t : T) : outcome :=
  explore same_pair hash_pair pair_moves pair_good fuel [([], (t, initial tables))] Vacant.

Lemma same_pair_iff : forall a b, same_pair a b = true <-> a = b.
Proof.
  intros [t q] [t' q']; unfold same_pair; simpl. rewrite andb_true_iff, same_text_iff, same_state_of_automaton_iff.
  split; [intros [-> ->]; auto | intros Q; injection Q; auto].
Qed.

(** After each word, a certified text is in a state that fits the state of the automaton. *)
Theorem compare_sound : forall fuel t, compare_with_automaton fuel t = Certified ->
  forall word, Forall (fun l => In l possible) word ->
  fits (fold_left text_step word t) (fold_left (delta s tables) word (initial tables)) = true.
Proof.
  intros fuel t H word F.
  assert (R : Reachable pair_moves (t, initial tables)
                (fold_left text_step word t, fold_left (delta s tables) word (initial tables))).
  { induction word as [| l word IH] using rev_ind; [constructor |]. rewrite !fold_left_app. simpl.
    apply Forall_app in F as [F L]. inversion L; subst. eapply reachable_move; [exact (IH F) |].
    unfold pair_moves. rewrite text_moves_map. simpl. instantiate (1 := l).
    rewrite <- (map_id possible) at 1. rewrite map2_map. apply in_map_iff. exists l; auto. }
  apply (explore_sound _ _ same_pair_iff _ _ _ _ H) in R. exact R.
Qed.
End Text.

(** A text whose states accept or not fits when it accepts in the same states; [None] is "unclear". *)
Definition accepting (q : state) : bool := match q with Accepting => true | Watching _ => false end.
Definition accepts_alike (text_accepts : option bool) (q : state) : bool :=
  match text_accepts with Some b => Bool.eqb b (accepting q) | None => false end.

Lemma accepts_alike_iff : forall b q, accepts_alike b q = true <-> b = Some (accepting q).
Proof.
  intros [b |] q; simpl; [| split; discriminate]. rewrite eqb_true_iff. split; congruence.
Qed.

(** ** Letters *)

Definition all_among (ps qs : list nat) : bool := forallb (fun p => member p qs) ps.

Lemma all_among_incl : forall ps qs, all_among ps qs = true -> incl ps qs.
Proof. unfold all_among; intros ps qs H p I. rewrite forallb_forall in H. now apply member_iff, H. Qed.

(** All letters over some predicates. *)
Fixpoint every_letter (predicates : list nat) : list letter :=
  match predicates with
  | [] => [[]]
  | p :: ps => let l := every_letter ps in l ++ map (cons p) l
  end.

Lemma every_letter_possible : forall E (satisfies : nat -> E -> bool) ps e,
  In (letter_of satisfies ps e) (every_letter ps).
Proof.
  intros E satisfies ps e; induction ps as [| p ps IH]; simpl; auto. apply in_app_iff.
  destruct (satisfies p e); [right; now apply in_map | auto].
Qed.

(** Texts read valuations of predicates: those of letters, or those of events. *)
Definition predicates_of (a : letter) : nat -> bool := fun p => member p a.
Definition word_of (word : list letter) : list (nat -> bool) := map predicates_of word.
Definition valuations {E} (satisfies : nat -> E -> bool) (u : list E) : list (nat -> bool) :=
  map (fun e p => satisfies p e) u.
