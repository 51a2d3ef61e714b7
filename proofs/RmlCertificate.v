(** * Certifying RML texts

    The rules of [Rml.v] as a function with a bound on its depth, explored beside the automaton.  The
    verdicts of RML come from the rules, so a certified text has the verdict of the definition without
    further conditions. *)

Require Import List Bool Arith Lia.
Require Import RVAFT.Language RVAFT.Definition RVAFT.Search RVAFT.Plain RVAFT.Automaton RVAFT.Acceptance.
Require Import RVAFT.Exploration RVAFT.Rml.
Import ListNotations.

(** ** The rules as functions *)

Section Functions.
Variable equations : list term.

(** [None] when the depth runs out. *)
Fixpoint halts_in (depth : nat) (t : term) : option bool :=
  match depth with
  | O => None
  | S depth =>
    match t with
    | All | Empty | Star _ | Optional _ => Some true
    | Nothing | OfType _ => Some false
    | Concat x y | Intersection x y | Shuffle x y | Filter _ x y =>
      match halts_in depth x with Some true => halts_in depth y | found => found end
    | Union x y => match halts_in depth x with Some false => halts_in depth y | found => found end
    | Call n => halts_in depth (body equations n)
    end
  end.

Fixpoint step_in (depth : nat) (a : nat -> bool) (t : term) : option (option term) :=
  match depth with
  | O => None
  | S depth =>
    match t with
    | All => Some (Some All)
    | Empty | Nothing => Some None
    | OfType t => Some (if fits t a then Some Empty else None)
    | Union x y => match step_in depth a x with Some None => step_in depth a y | found => found end
    | Intersection x y =>
      match step_in depth a x, step_in depth a y with
      | Some (Some x'), Some (Some y') => Some (Some (joined x' y'))
      | Some _, Some _ => Some None
      | _, _ => None
      end
    | Shuffle x y =>
      match step_in depth a x with
      | Some (Some x') => Some (Some (shuffled x' y))
      | Some None => option_map (option_map (shuffled x)) (step_in depth a y)
      | None => None
      end
    | Concat x y =>
      match step_in depth a x with
      | Some (Some x') => Some (Some (then_ x' y))
      | Some None =>
        match halts_in depth x with
        | Some true => step_in depth a y
        | Some false => Some None
        | None => None
        end
      | None => None
      end
    | Filter t x y =>
      if fits t a then option_map (option_map (fun x' => filtered t x' y)) (step_in depth a x)
      else option_map (option_map (filtered t x)) (step_in depth a y)
    | Star x => option_map (option_map (fun x' => then_ x' (Star x))) (step_in depth a x)
    | Optional x => step_in depth a x
    | Call n => step_in depth a (body equations n)
    end
  end.

Lemma halts_in_sound : forall depth t b, halts_in depth t = Some b -> Halts equations t b.
Proof.
  induction depth as [| depth IH]; intros t b H; [discriminate |].
  assert (J : forall t x y, operands t = Some (x, y) ->
    match halts_in depth x with Some true => halts_in depth y | found => found end = Some b -> Halts equations t b).
  { intros t' x y O K. destruct (halts_in depth x) as [[] |] eqn:X; try discriminate; apply IH in X.
    - apply IH in K. now apply halts_second with x y.
    - injection K as <-. now apply halts_first with x y. }
  destruct t as [| | | t | x y | x y | x y | x y | t x y | x | x | n]; simpl in H;
    try (injection H as <-; constructor; fail); try (eapply J; [reflexivity | exact H]).
  - destruct (halts_in depth x) as [[] |] eqn:X; try discriminate; apply IH in X.
    + injection H as <-. now apply halts_left.
    + apply IH in H. now apply halts_right.
  - constructor. auto.
Qed.

Lemma step_in_sound : forall depth a t r, step_in depth a t = Some r -> Step equations a t r.
Proof.
  induction depth as [| depth IH]; intros a t r H; [discriminate |].
  destruct t as [| | | t | x y | x y | x y | x y | t x y | x | x | n]; simpl in H.
  - injection H as <-. constructor.
  - injection H as <-. constructor.
  - injection H as <-. constructor.
  - injection H as <-. constructor.
  - destruct (step_in depth a x) as [[x' |] |] eqn:X; try discriminate; apply IH in X.
    + injection H as <-. now constructor.
    + destruct (halts_in depth x) as [[] |] eqn:Z; try discriminate; apply halts_in_sound in Z.
      * apply step_second; auto.
      * injection H as <-. now apply step_neither.
  - destruct (step_in depth a x) as [[x' |] |] eqn:X; try discriminate; apply IH in X.
    + injection H as <-. now constructor.
    + apply step_right; auto.
  - destruct (step_in depth a x) as [q |] eqn:X; try discriminate; apply IH in X.
    destruct (step_in depth a y) as [q' |] eqn:Y; [| destruct q; discriminate]. apply IH in Y.
    pose proof (step_both _ _ _ _ _ _ X Y) as B. destruct q as [x' |], q' as [y' |]; injection H as <-; exact B.
  - destruct (step_in depth a x) as [[x' |] |] eqn:X; try discriminate; apply IH in X.
    + injection H as <-. now constructor.
    + destruct (step_in depth a y) as [q |] eqn:Y; try discriminate. apply IH in Y. simpl in H. injection H as <-.
      now apply step_shuffle_right.
  - destruct (fits t a) eqn:F.
    + destruct (step_in depth a x) as [q |] eqn:X; try discriminate. apply IH in X. simpl in H. injection H as <-.
      now apply step_inside.
    + destruct (step_in depth a y) as [q |] eqn:Y; try discriminate. apply IH in Y. simpl in H. injection H as <-.
      now apply step_outside.
  - destruct (step_in depth a x) as [q |] eqn:X; try discriminate. apply IH in X. simpl in H. injection H as <-.
    now apply step_star.
  - apply step_optional; auto.
  - apply step_call; auto.
Qed.
End Functions.

(** ** Only the predicates of a text matter *)

Fixpoint type_over (ps : list nat) (t : event_type) : bool :=
  match t with
  | AnyEvent | NoEvent => true
  | Predicate p => member p ps
  | NotType t => type_over ps t
  | EitherType t t' | BothTypes t t' => type_over ps t && type_over ps t'
  end.

Fixpoint term_over (ps : list nat) (t : term) : bool :=
  match t with
  | All | Empty | Nothing | Call _ => true
  | OfType t => type_over ps t
  | Concat x y | Union x y | Intersection x y | Shuffle x y => term_over ps x && term_over ps y
  | Filter t x y => type_over ps t && term_over ps x && term_over ps y
  | Star x | Optional x => term_over ps x
  end.

Lemma fits_over : forall ps a b t, (forall p, In p ps -> a p = b p) -> type_over ps t = true -> fits t a = fits t b.
Proof.
  intros ps a b t H; induction t as [| | p | t IH | t IH t' IH' | t IH t' IH']; simpl; intros O; auto.
  - apply H. now apply member_iff.
  - now rewrite IH.
  - apply andb_true_iff in O as [O O']. now rewrite IH, IH'.
  - apply andb_true_iff in O as [O O']. now rewrite IH, IH'.
Qed.

Lemma over_then : forall ps x y, term_over ps x = true -> term_over ps y = true -> term_over ps (then_ x y) = true.
Proof. intros ps x y A B; destruct x, y; simpl in *; rewrite ?A, ?B; auto. Qed.
Lemma over_shuffled : forall ps x y, term_over ps x = true -> term_over ps y = true ->
  term_over ps (shuffled x y) = true.
Proof. intros ps x y A B; destruct x, y; simpl in *; rewrite ?A, ?B; auto. Qed.
Lemma over_joined : forall ps x y, term_over ps x = true -> term_over ps y = true -> term_over ps (joined x y) = true.
Proof. intros ps x y A B; destruct x, y; simpl in *; rewrite ?A, ?B; auto. Qed.
Lemma over_filtered : forall ps t x y, type_over ps t = true -> term_over ps x = true -> term_over ps y = true ->
  term_over ps (filtered t x y) = true.
Proof. intros ps t x y T A B; destruct x, y; simpl in *; rewrite ?T, ?A, ?B; auto. Qed.

Lemma over_body : forall ps eqs n, forallb (term_over ps) eqs = true -> term_over ps (body eqs n) = true.
Proof.
  intros ps eqs n O. unfold body. destruct (lt_dec n (length eqs)); [| rewrite nth_overflow by lia; reflexivity].
  rewrite forallb_forall in O. apply O, nth_In; auto.
Qed.

Lemma step_over : forall ps eqs a b, forallb (term_over ps) eqs = true -> (forall p, In p ps -> a p = b p) ->
  forall t r, Step eqs a t r -> term_over ps t = true ->
  Step eqs b t r /\ match r with Some t' => term_over ps t' = true | None => True end.
Proof.
  intros ps eqs a b O H t r S; induction S; simpl; intros T;
    rewrite ?andb_true_iff in T; repeat match goal with T : _ /\ _ |- _ => destruct T end;
    repeat match goal with
    | IH : ?P = true -> _ /\ _, K : ?P = true |- _ => destruct (IH K); clear IH
    end.
  - split; auto; constructor.
  - split; auto; constructor.
  - split; auto; constructor.
  - rewrite (fits_over ps a b t H T). split; [constructor | destruct (fits t b); auto].
  - split; auto. now apply step_left.
  - split; auto. now apply step_right.
  - split; [now apply step_both |]. destruct r, q; auto. now apply over_joined.
  - split; [now apply step_shuffle_left | now apply over_shuffled].
  - split; [now apply step_shuffle_right |]. destruct r; simpl; auto. now apply over_shuffled.
  - split; [now apply step_first | now apply over_then].
  - split; auto. now apply step_second.
  - split; auto. now apply step_neither.
  - rewrite (fits_over ps a b t H) in * by auto. split; [now apply step_inside |]. destruct r; simpl; auto.
    now apply over_filtered.
  - rewrite (fits_over ps a b t H) in * by auto. split; [now apply step_outside |]. destruct r; simpl; auto.
    now apply over_filtered.
  - split; [now apply step_star |]. destruct r; simpl; auto. now apply over_then.
  - split; auto. now apply step_optional.
  - destruct IHS as [S' R]; [now apply over_body |]. split; auto. now apply step_call.
Qed.

Lemma verdict_over : forall ps eqs, forallb (term_over ps) eqs = true -> forall t u v, RmlVerdict eqs t u v -> forall w,
  Forall2 (fun a b => forall p, In p ps -> a p = b p) u w -> term_over ps t = true -> RmlVerdict eqs t w v.
Proof.
  intros ps eqs O t u v K; induction K as [t u H | t H | t a u H S | t a u t' v H S K IH]; intros w F T; inversion F;
    subst.
  - now apply verdict_halts.
  - now apply verdict_halts.
  - now apply verdict_open.
  - apply verdict_stops; auto. now apply (step_over ps eqs a y O H2 t None).
  - destruct (step_over ps eqs a y O H2 t (Some t') S T) as [S' T']. apply verdict_goes_on with t'; auto.
Qed.

(** ** The certificate *)

Inductive reading := On (t : term) | Halted | Stopped | Unsure.

Definition settle (eqs : list term) (depth : nat) (t : term) : reading :=
  match halts_in eqs depth t with Some true => Halted | Some false => On t | None => Unsure end.

Definition rml_step (eqs : list term) (depth : nat) (r : reading) (a : letter) : reading :=
  match r with
  | On t =>
    match step_in eqs depth (predicates_of a) t with
    | Some (Some t') => settle eqs depth t'
    | Some None => Stopped
    | None => Unsure
    end
  | Halted | Stopped | Unsure => r
  end.

Definition reading_verdict (r : reading) : option verdict :=
  match r with On _ => Some Unknown | Halted => Some Top | Stopped => Some Bottom | Unsure => None end.

Definition same_verdict (v w : verdict) : bool :=
  match v, w with Top, Top | Bottom, Bottom | Unknown, Unknown => true | _, _ => false end.

Definition reading_fits (r : reading) (q : state) : bool :=
  match reading_verdict r with Some v => same_verdict v (verdict_at q) | None => false end.

Fixpoint same_type (t t' : event_type) : bool :=
  match t, t' with
  | AnyEvent, AnyEvent | NoEvent, NoEvent => true
  | Predicate p, Predicate q => Nat.eqb p q
  | NotType t, NotType t' => same_type t t'
  | EitherType t u, EitherType t' u' | BothTypes t u, BothTypes t' u' => same_type t t' && same_type u u'
  | _, _ => false
  end.

Fixpoint same_term (t t' : term) : bool :=
  match t, t' with
  | All, All | Empty, Empty | Nothing, Nothing => true
  | OfType t, OfType t' => same_type t t'
  | Concat x y, Concat x' y' | Union x y, Union x' y'
  | Intersection x y, Intersection x' y' | Shuffle x y, Shuffle x' y' =>
    same_term x x' && same_term y y'
  | Filter t x y, Filter t' x' y' => same_type t t' && same_term x x' && same_term y y'
  | Star x, Star x' | Optional x, Optional x' => same_term x x'
  | Call n, Call m => Nat.eqb n m
  | _, _ => false
  end.

Definition same_reading (r r' : reading) : bool :=
  match r, r' with
  | On t, On t' => same_term t t'
  | Halted, Halted | Stopped, Stopped | Unsure, Unsure => true
  | _, _ => false
  end.

Lemma same_type_iff : forall t t', same_type t t' = true <-> t = t'.
Proof.
  induction t; destruct t'; simpl; try (split; congruence).
  - rewrite Nat.eqb_eq. split; congruence.
  - rewrite IHt. split; congruence.
  - rewrite andb_true_iff, IHt1, IHt2. split; [intros [-> ->]; auto | intros Q; injection Q; auto].
  - rewrite andb_true_iff, IHt1, IHt2. split; [intros [-> ->]; auto | intros Q; injection Q; auto].
Qed.

Lemma same_term_iff : forall t t', same_term t t' = true <-> t = t'.
Proof.
  induction t; destruct t'; simpl; try (split; congruence);
    rewrite ?andb_true_iff, ?same_type_iff, ?Nat.eqb_eq, ?IHt, ?IHt1, ?IHt2;
    (split; [intuition congruence | intros Q; injection Q; auto]).
Qed.

Lemma same_reading_iff : forall r r', same_reading r r' = true <-> r = r'.
Proof. intros [t | | |] [t' | | |]; simpl; rewrite ?same_term_iff; split; congruence. Qed.

Fixpoint hash_term (mix : mixing) (t : term) : nat :=
  match t with
  | All => 1
  | Empty => 2
  | Nothing => 3
  | OfType _ => 4
  | Concat x y => mix (mix 5 (hash_term mix x)) (hash_term mix y)
  | Union x y => mix (mix 6 (hash_term mix x)) (hash_term mix y)
  | Intersection x y => mix (mix 7 (hash_term mix x)) (hash_term mix y)
  | Shuffle x y => mix (mix 8 (hash_term mix x)) (hash_term mix y)
  | Filter _ x y => mix (mix 9 (hash_term mix x)) (hash_term mix y)
  | Star x => mix 10 (hash_term mix x)
  | Optional x => mix 11 (hash_term mix x)
  | Call n => mix 12 n
  end.

Definition hash_reading (mix : mixing) (r : reading) : nat :=
  match r with On t => hash_term mix t | Halted => 13 | Stopped => 14 | Unsure => 15 end.

(** A text is a term with its equations; [depth] bounds the nesting of terms and calls in one step. *)
Definition certify_rml (mix : mixing) (s : semantics) (xs : list shape) (predicates : list nat) (possible : list letter)
  (fuel depth : nat) (eqs : list term) (t : term) : outcome :=
  if all_among (alphabet xs) predicates && forallb (term_over predicates) eqs && term_over predicates t
  then compare_with_automaton mix same_reading (hash_reading mix) (fun r l => map (rml_step eqs depth r) l) reading_fits
         s (map rows xs) possible fuel (settle eqs depth t)
  else Exhausted.

Lemma final_stays : forall eqs depth word r, match r with On _ => False | _ => True end ->
  fold_left (rml_step eqs depth) word r = r.
Proof. intros eqs depth; induction word; intros r F; auto. simpl. rewrite IHword; destruct r; auto; destruct F. Qed.

(** What is read is the verdict by the rules. *)
Lemma reading_correct : forall eqs depth word t v,
  reading_verdict (fold_left (rml_step eqs depth) word (settle eqs depth t)) = Some v ->
    RmlVerdict eqs t (word_of word) v.
Proof.
  intros eqs depth; induction word as [| a word IH]; intros t v H; unfold settle in H.
  - simpl in *. destruct (halts_in eqs depth t) as [[] |] eqn:Z; try discriminate; apply halts_in_sound in Z;
      injection H as <-; [now apply verdict_halts | now apply verdict_open].
  - destruct (halts_in eqs depth t) as [[] |] eqn:Z; [| |rewrite final_stays in H by exact I; discriminate];
      apply halts_in_sound in Z.
    + rewrite final_stays in H by exact I. injection H as <-. now apply verdict_halts.
    + simpl in H. destruct (step_in eqs depth (predicates_of a) t) as [[t' |] |] eqn:S;
        [| |rewrite final_stays in H by exact I; discriminate]; apply step_in_sound in S.
      * simpl. apply verdict_goes_on with t'; auto.
      * rewrite final_stays in H by exact I. injection H as <-. now apply verdict_stops.
Qed.

Lemma same_verdict_iff : forall v w, same_verdict v w = true <-> v = w.
Proof. intros [] []; simpl; split; congruence. Qed.

Section Certificate.
Context {E : Type}.
Variable satisfies : nat -> E -> bool.
Notation relevant := (relevant satisfies).
Notation Rel := (fun e => relevant e = true).
Notation plain := (plain satisfies).
Notation valuations := (valuations satisfies).

Lemma verdict_only : forall (R : E -> Prop) plans s u v w, Verdict R plans s u v -> Verdict R plans s u w -> v = w.
Proof. intros R plans s u [] []; simpl; tauto. Qed.

Lemma letters_valuations : forall predicates (u : list E),
  Forall2 (fun a b => forall p, In p predicates -> a p = b p) (word_of (letters satisfies predicates u)) (valuations u).
Proof.
  intros ps u; induction u as [| e u IH]; simpl; constructor; auto. intros p I. unfold predicates_of.
  now apply member_letter.
Qed.

(** A text of RML with the verdicts of the automaton on the letters has the verdicts of the
    definition on the events. *)
Lemma rml_verdict_of_automaton : forall s xs predicates eqs t, In relevance predicates ->
  Forall (well_lettered predicates) xs -> forallb (term_over predicates) eqs = true -> term_over predicates t = true ->
  (forall u, RmlVerdict eqs t (word_of (letters satisfies predicates u))
               (verdict_at (automaton_after satisfies predicates s xs u))) ->
  forall u v, RmlVerdict eqs t (valuations u) v <-> Verdict Rel (Scenarios (map plain xs)) s u v.
Proof.
  intros s xs ps eqs t R W O T K u v.
  assert (D : RmlVerdict eqs t (valuations u) (verdict_at (automaton_after satisfies ps s xs u)))
    by (eapply verdict_over; eauto using letters_valuations).
  pose proof (automaton_correct satisfies ps s xs u R W) as A. split; intros H.
  - now rewrite (verdict_unique _ _ _ _ H _ D).
  - now rewrite (verdict_only _ _ _ _ _ _ H A).
Qed.

Lemma alphabet_among : forall xs predicates, all_among (alphabet xs) predicates = true ->
  In relevance predicates /\ Forall (well_lettered predicates) xs.
Proof.
  intros xs ps A. apply all_among_incl in A. split; [apply A; simpl; auto |].
  apply Forall_forall. intros x I p J. apply A. right. apply in_flat_map; eauto.
Qed.

(** A certified text has the verdict of the definition on every trace. *)
Theorem certify_rml_verdict : forall mix s xs predicates possible fuel depth eqs t,
  certify_rml mix s xs predicates possible fuel depth eqs t = Certified ->
  (forall e, In (letter_of satisfies predicates e) possible) ->
  forall u v, RmlVerdict eqs t (valuations u) v <-> Verdict Rel (Scenarios (map plain xs)) s u v.
Proof.
  intros mix s xs ps possible fuel depth eqs t C P. unfold certify_rml in C.
  destruct (all_among (alphabet xs) ps && forallb (term_over ps) eqs && term_over ps t) eqn:A; [| discriminate].
  rewrite !andb_true_iff in A. destruct A as [[A O] T]. apply alphabet_among in A as [R W].
  apply rml_verdict_of_automaton with ps; auto. intros u.
  assert (F : Forall (fun l => In l possible) (letters satisfies ps u)).
  { apply Forall_forall. intros l I. apply in_map_iff in I as (e & <- & _). auto. }
  pose proof (compare_sound mix same_reading (hash_reading mix) (fun r l => map (rml_step eqs depth r) l)
    (rml_step eqs depth) reading_fits same_reading_iff (fun _ _ => eq_refl) s (map rows xs) possible fuel _ C _ F) as K.
  unfold reading_fits in K. destruct (reading_verdict _) as [v |] eqn:V; [| discriminate].
  apply same_verdict_iff in K. apply reading_correct in V. rewrite K in V. exact V.
Qed.

(** ** The determinised form *)

(** States of the text mean states of the automaton, and the first alternative that fits leads where
    the automaton goes. *)
Definition chooses_right (s : semantics) (tables : list (list row)) (predicates : list nat)
  (states : list (list alternative)) (means : nat -> state) : Prop :=
  means 0 = initial tables /\ verdict_at (means 0) = Unknown /\
  forall n (e : E), verdict_at (means n) = Unknown ->
    let a := letter_of satisfies predicates e in
    match first_fit (nth n states []) (predicates_of a) with
    | None => verdict_at (delta s tables (means n) a) = Bottom
    | Some x => match leads_to x with
                | None => delta s tables (means n) a = Accepting
                | Some m => delta s tables (means n) a = means m /\ verdict_at (means m) = Unknown
                end
    end.

(** Such a text runs as the automaton does. *)
Lemma means_follow : forall s xs predicates states means, In relevance predicates ->
  Forall (well_lettered predicates) xs ->
  chooses_right s (map rows xs) predicates states means ->
  forall u p n, means n = automaton_after satisfies predicates s xs p -> verdict_at (means n) = Unknown ->
  run_states states n (word_of (letters satisfies predicates u))
    = verdict_at (automaton_after satisfies predicates s xs (p ++ u)).
Proof.
  intros s xs ps states means R W (_ & _ & C); induction u as [| e u IH]; intros p n M N.
  - rewrite app_nil_r, <- M. symmetry; exact N.
  - specialize (C n e N). cbv zeta in C. simpl run_states.
    assert (Q : automaton_after satisfies ps s xs (p ++ [e])
                = delta s (map rows xs) (means n) (letter_of satisfies ps e)).
    { rewrite M. unfold automaton_after, letters. now rewrite map_app, fold_left_app. }
    replace (p ++ e :: u) with ((p ++ [e]) ++ u) by now rewrite <- app_assoc.
    destruct (first_fit _ _) as [x |]; [destruct (leads_to x) as [m |] |].
    + destruct C as [C M']. apply IH; congruence.
    + rewrite <- Q in C. apply (automaton_accepts satisfies ps s xs (p ++ [e]) R W) in C.
      apply (detected_app _ _ _ _ u), (automaton_accepts satisfies ps s xs _ R W) in C. now rewrite C.
    + rewrite <- Q in C. pose proof (automaton_correct satisfies ps s xs (p ++ [e]) R W) as V. rewrite C in V.
      apply (bottom_stays relevant s (map plain xs) (p ++ [e]) u) in V; [| apply all_lawful].
      apply (verdict_only _ _ _ _ _ _ V). now apply automaton_correct.
Qed.

(** A deterministic choice of event types per state has the verdict of the definition on every
    trace. *)
Theorem determinised_correct : forall s xs predicates states means,
  all_among (alphabet xs) predicates = true -> forallb (term_over predicates) (determinised states) = true ->
  chooses_right s (map rows xs) predicates states means ->
  forall u v, RmlVerdict (determinised states) (Call 0) (valuations u) v <->
    Verdict Rel (Scenarios (map plain xs)) s u v.
Proof.
  intros s xs ps states means A O C. apply alphabet_among in A as [R W].
  apply rml_verdict_of_automaton with ps; auto. intros u. destruct C as (Z & N & C).
  pose proof (means_follow s xs ps states means R W (conj Z (conj N C)) u [] 0 Z N) as Q. simpl app in Q.
  rewrite <- Q. apply determinised_runs. left; auto.
Qed.
End Certificate.
