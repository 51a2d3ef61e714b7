(** * RML with variables: the deterministic rules with substitution

    A text [{let x, y; t}], whose block is outermost, is monitored under one assignment of its variables:
    an event type that takes an event gives values to the variables that have none, and these values are
    substituted in the rest of the text.  Here the substitution is an environment.  Variables that the
    block does not declare are local to the event type. *)

Require Import List Bool Arith ZArith Lia.
Require Import RVAFT.Values RVAFT.Language RVAFT.Definition RVAFT.Search RVAFT.Conditions RVAFT.Scenarios.
Require Import RVAFT.Monitor RVAFT.Plain RVAFT.Automaton RVAFT.Exploration RVAFT.Letters RVAFT.PlainTree.
Require Import RVAFT.Rml RVAFT.RmlCertificate RVAFT.Slices RVAFT.SlicedTree RVAFT.SlicedCertificate RVAFT.Determined.
Import ListNotations.

Section Rules.
Variable equations : list term.
Variable closed : nat -> event -> bool.  (* the predicates whose variables are their own, with numbers below [first] *)
Variable first : nat.
Variable qs : list atom.                 (* the numbers from [first] on *)
Variable shared : list nat.              (* the variables of the block *)

(** ** Event types *)

(** An assignment with values for more variables. *)
Definition extended (b : assignment) (bs : binding nat) : assignment :=
  fun x => match b x with Some v => Some v | None => lookup Nat.eqb bs x end.

Definition kept (c : assignment) : assignment := fun x => if Conditions.member x shared then c x else None.

(** The first way in which an event matches a pattern with guards, under the values that are known. *)
Definition taken (b : assignment) (e : event) (q : atom) : option assignment :=
  option_map kept (find (fun c => observes q (e, c)) (map (extended b) (bindings (atom_pattern q) (content e)))).

(** Each variable of a guard has a value, or gets one. *)
Definition testable (known : nat -> bool) (q : atom) : bool :=
  match atom_time q with None => true | Some _ => false end &&
  forallb (fun g => forallb (fun x => known x || mentions x (atom_pattern q)) (variables g)) (atom_guards q).

Fixpoint type_variables (ty : event_type) : list nat :=
  match ty with
  | AnyEvent | NoEvent => []
  | Predicate k => if k <? first then [] else
    match nth_error qs (k - first) with Some q => filter (fun x => Conditions.member x shared) (atom_variables q) |
      None => [] end
  | NotType ty => type_variables ty
  | EitherType ty ty' | BothTypes ty ty' => type_variables ty ++ type_variables ty'
  end.

(** The assignment after an event that the type takes, or none.  The rules do not say what a guard or a negation
    means while one of its variables has no value. *)
Fixpoint test (b : assignment) (e : event) (ty : event_type) : option (option assignment) :=
  match ty with
  | AnyEvent => Some (Some b)
  | NoEvent => Some None
  | Predicate k =>
    if k <? first then Some (if closed k e then Some b else None)
    else match nth_error qs (k - first) with
         | Some q => if testable (binds b) q then Some (taken b e q) else None
         | None => Some None
         end
  | NotType ty =>
    if forallb (binds b) (type_variables ty)
    then match test b e ty with Some (Some _) => Some None | Some None => Some (Some b) | None => None end
    else None
  | EitherType ty ty' => match test b e ty with Some None => test b e ty' | found => found end
  | BothTypes _ _ => None
  end.

(** ** The rules *)

Definition merged (c d : assignment) : assignment := fun x => match c x with Some v => Some v | None => d x end.
Definition compatible (c d : assignment) : Prop := forall x v w, c x = Some v -> d x = Some w -> v = w.

Notation after f r := (option_map (fun p : term * assignment => (f (fst p), snd p)) r).

(** The term and the assignment after an event, or [None] where no rule applies. *)
Inductive Goes (e : event) : assignment -> term -> option (term * assignment) -> Prop :=
| goes_all : forall b, Goes e b All (Some (All, b))
| goes_empty : forall b, Goes e b Empty None
| goes_nothing : forall b, Goes e b Nothing None
| goes_event : forall b ty r, test b e ty = Some r -> Goes e b (OfType ty) (option_map (pair Empty) r)
| goes_left : forall b x y r, Goes e b x (Some r) -> Goes e b (Union x y) (Some r)
| goes_right : forall b x y r, Goes e b x None -> Goes e b y r -> Goes e b (Union x y) r
| goes_both : forall b x y x' y' c d, Goes e b x (Some (x', c)) -> Goes e b y (Some (y', d)) -> compatible c d ->
    Goes e b (Intersection x y) (Some (joined x' y', merged c d))
| goes_conflict : forall b x y x' y' c d, Goes e b x (Some (x', c)) -> Goes e b y (Some (y', d)) ->
    ~ compatible c d -> Goes e b (Intersection x y) None
| goes_not_left : forall b x y, Goes e b x None -> Goes e b (Intersection x y) None
| goes_not_right : forall b x y, Goes e b y None -> Goes e b (Intersection x y) None
| goes_shuffle_left : forall b x y r, Goes e b x (Some r) ->
    Goes e b (Shuffle x y) (after (fun x' => shuffled x' y) (Some r))
| goes_shuffle_right : forall b x y r, Goes e b x None -> Goes e b y r ->
    Goes e b (Shuffle x y) (after (shuffled x) r)
| goes_first : forall b x y r, Goes e b x (Some r) -> Goes e b (Concat x y) (after (fun x' => then_ x' y) (Some r))
| goes_second : forall b x y r, Goes e b x None -> Halts equations x true -> Goes e b y r -> Goes e b (Concat x y) r
| goes_neither : forall b x y, Goes e b x None -> Halts equations x false -> Goes e b (Concat x y) None
| goes_inside : forall b ty x y c r, type_variables ty = [] -> test b e ty = Some (Some c) -> Goes e b x r ->
    Goes e b (Filter ty x y) (after (fun x' => filtered ty x' y) r)
| goes_outside : forall b ty x y r, type_variables ty = [] -> test b e ty = Some None -> Goes e b y r ->
    Goes e b (Filter ty x y) (after (filtered ty x) r)
| goes_star : forall b x r, Goes e b x r -> Goes e b (Star x) (after (fun x' => then_ x' (Star x)) r)
| goes_optional : forall b x r, Goes e b x r -> Goes e b (Optional x) r
| goes_call : forall b n r, Goes e b (body equations n) r -> Goes e b (Call n) r.

(** The verdict of a text (section 5 of the definition), from some assignment on. *)
Inductive BlockVerdict : assignment -> term -> list event -> verdict -> Prop :=
| block_halts : forall b x u, Halts equations x true -> BlockVerdict b x u Top
| block_open : forall b x, Halts equations x false -> BlockVerdict b x [] Unknown
| block_stops : forall b x e u, Halts equations x false -> Goes e b x None -> BlockVerdict b x (e :: u) Bottom
| block_goes_on : forall b x e u x' c v, Halts equations x false -> Goes e b x (Some (x', c)) ->
    BlockVerdict c x' u v -> BlockVerdict b x (e :: u) v.

(** The rules are deterministic. *)
Lemma goes_unique : forall e b x r, Goes e b x r -> forall q, Goes e b x q -> r = q.
Proof.
  induction 1; intros s K; inversion K; subst; auto;
    repeat match goal with
    | IH : forall q, Goes ?e ?b ?x q -> ?r = q, H : Goes ?e ?b ?x ?q' |- _ =>
      apply IH in H; try discriminate H; try (injection H; clear H; intros; subst); subst
    end; auto; try congruence; try tauto.
  all: match goal with H : Halts _ ?x true, H' : Halts _ ?x false |- _ => pose proof (halts_unique _ _ _ H _ H');
    discriminate end.
Qed.

Theorem block_unique : forall b x u v, BlockVerdict b x u v -> forall v', BlockVerdict b x u v' -> v = v'.
Proof.
  induction 1 as [b x u H | b x H | b x e u H S | b x e u x' c v H S K IH]; intros v' K'; inversion K'; subst; auto;
    try match goal with H : Halts _ ?x true, H' : Halts _ ?x false |- _ => pose proof (halts_unique _ _ _ H _ H');
      discriminate end;
    match goal with H : Goes _ _ _ _ |- _ => apply (goes_unique _ _ _ _ S) in H; try discriminate H end.
  match goal with H : Some _ = Some _ |- _ => injection H as -> -> end. auto.
Qed.

(** ** The rules over letters *)

Section Letter.
Variable bound : list nat.               (* the variables that have a value *)
Variable hidden : list nat.              (* those that no event type asks for yet *)
Variable a : nat -> bool.                (* what the event satisfies once the other variables have values *)

Notation known := (fun x => Conditions.member x bound).
Notation asked := (fun x => known x || negb (Conditions.member x hidden)).

(** The variables that get a value by an event that the type takes. *)
Fixpoint test_in (ty : event_type) : option (option (list nat)) :=
  match ty with
  | AnyEvent => Some (Some [])
  | NoEvent => Some None
  | Predicate k =>
    if k <? first then Some (if a k then Some [] else None)
    else match nth_error qs (k - first) with
         | Some q => if testable known q && forallb asked (atom_variables q)
           then Some (if a k then Some (filter (fun x => Conditions.member x shared) (atom_variables q)) else None)
           else None
         | None => Some None
         end
  | NotType ty =>
    if forallb known (type_variables ty)
    then match test_in ty with Some (Some _) => Some None | Some None => Some (Some []) | None => None end
    else None
  | EitherType ty ty' => match test_in ty with Some None => test_in ty' | found => found end
  | BothTypes _ _ => None
  end.

Notation after_in f r := (option_map (option_map (fun p : term * list nat => (f (fst p), snd p))) r).

Fixpoint go_in (depth : nat) (x : term) : option (option (term * list nat)) :=
  match depth with
  | O => None
  | S depth =>
    match x with
    | All => Some (Some (All, []))
    | Empty | Nothing => Some None
    | OfType ty => option_map (option_map (pair Empty)) (test_in ty)
    | Union x y => match go_in depth x with Some None => go_in depth y | found => found end
    | Intersection x y =>
      match go_in depth x, go_in depth y with
      | Some (Some (x', c)), Some (Some (y', d)) => Some (Some (joined x' y', c ++ d))
      | Some None, _ | _, Some None => Some None
      | _, _ => None
      end
    | Shuffle x y =>
      match go_in depth x with
      | Some None => after_in (shuffled x) (go_in depth y)
      | found => after_in (fun x' => shuffled x' y) found
      end
    | Concat x y =>
      match go_in depth x with
      | Some None =>
        match halts_in equations depth x with
        | Some true => go_in depth y
        | Some false => Some None
        | None => None
        end
      | found => after_in (fun x' => then_ x' y) found
      end
    | Filter ty x y =>
      match type_variables ty, test_in ty with
      | [], Some (Some _) => after_in (fun x' => filtered ty x' y) (go_in depth x)
      | [], Some None => after_in (filtered ty x) (go_in depth y)
      | _, _ => None
      end
    | Star x => after_in (fun x' => then_ x' (Star x)) (go_in depth x)
    | Optional x => go_in depth x
    | Call n => go_in depth (body equations n)
    end
  end.
End Letter.

(** *** They follow the rules *)

Section Soundness.
Hypothesis patterns_determined : determined (map atom_pattern qs) = true.
Variable b : assignment.
Variable e : event.
Variables bound hidden : list nat.
Variable a : nat -> bool.
Hypothesis bound_iff : forall x, binds b x = Conditions.member x bound.
Hypothesis bound_shared : forall x, binds b x = true -> Conditions.member x shared = true.
Hypothesis closed_letter : forall k, k < first -> a k = closed k e.
Hypothesis atom_letter : forall k q, first <= k -> nth_error qs (k - first) = Some q ->
  a k = observes q (e, completed (map atom_pattern qs) hidden b e).

Notation patterns := (map atom_pattern qs).
Notation b' := (completed patterns hidden b e).

(** These variables have got the values of the event. *)
Definition Gets (c : assignment) (news : list nat) : Prop :=
  (forall x, c x = match b x with Some v => Some v | None => if Conditions.member x news then found patterns (content e)
    x else None end) /\
  forall x, In x news -> binds c x = true /\ In x shared /\ (binds b x = true \/ Conditions.member x hidden = false).

Lemma gets_nothing : Gets b [].
Proof. split; [intros x; now destruct (b x) | intros x []]. Qed.

Lemma gets_completed : forall c l x v, Gets c l -> c x = Some v -> b' x = Some v.
Proof.
  intros c l x v [G N] Q. rewrite G in Q. unfold completed. destruct (b x) eqn:B; auto.
  destruct (Conditions.member x l) eqn:M; [| discriminate]. apply Conditions.member_iff, N in M as (_ & _ & [H | H]).
  - unfold binds in H. now rewrite B in H.
  - now rewrite H.
Qed.

Lemma gets_merged : forall c d l m, Gets c l -> Gets d m -> compatible c d /\ Gets (merged c d) (l ++ m).
Proof.
  intros c d l m C D. split; [| split].
  - intros x v w V W. apply (gets_completed c l) in V; auto. apply (gets_completed d m) in W; auto. congruence.
  - intros x. unfold merged. rewrite (proj1 C), (proj1 D). destruct (b x); auto.
    assert (M : Conditions.member x (l ++ m) = Conditions.member x l || Conditions.member x m)
      by (unfold Conditions.member; apply existsb_app).
    rewrite M. now destruct (Conditions.member x l), (Conditions.member x m), (found patterns (content e) x).
  - intros x X. unfold merged, binds. apply in_app_iff in X as [X | X].
    + apply (proj2 C) in X as [B S]. unfold binds in B. now destruct (c x).
    + apply (proj2 D) in X as [B S]. unfold binds in B. split; auto. now destruct (c x), (d x).
Qed.

(** What an atom observes depends on its variables only. *)
Lemma observes_same : forall q c d, (forall x, In x (atom_variables q) \/ (exists g, In g (atom_guards q) /\
  In x (variables g)) -> c x = d x) -> observes q (e, c) = true -> observes q (e, d) = true.
Proof.
  intros q c d H O. apply observes_iff in O as (L & V & F & T & G). apply observes_iff.
  assert (S : forall x, In x (atom_variables q) -> c x = d x) by auto.
  split; auto. split; [intros x X; unfold binds; rewrite <- (S x X); exact (V x X) | split; [| split]].
  - apply fits_pattern_same with (values_of c); auto. intros x X. unfold values_of. rewrite S; auto.
    apply in_app_iff; auto.
  - intros x X. unfold values_of. rewrite <- S; [exact (T x X) |]. unfold atom_variables. rewrite X.
    apply in_app_iff; simpl; auto.
  - intros g I. specialize (G g I). unfold passes in *.
    assert (B : forallb (binds d) (variables g) = forallb (binds c) (variables g)).
    { apply forallb_ext_in. intros x X. unfold binds. rewrite (H x); [reflexivity | right; exists g; auto]. }
    rewrite B.
    rewrite (holds_same (values_of d) (values_of c) no_time no_time); auto.
    intros x X. unfold values_of. rewrite (H x); [reflexivity | right; exists g; auto].
Qed.

Lemma taken_correct : forall q, In q qs -> testable (binds b) q = true ->
  (forall x, In x (atom_variables q) -> binds b x = true \/ Conditions.member x hidden = false) ->
  if observes q (e, b')
  then exists c, taken b e q = Some c /\ Gets c (filter (fun x => Conditions.member x shared) (atom_variables q))
  else taken b e q = None.
Proof.
  intros q I T AS. unfold testable in T. apply andb_true_iff in T as [T G].
  destruct (atom_time q) eqn:AT; [discriminate |]. clear T. rewrite forallb_forall in G.
  assert (AV : atom_variables q = pattern_variables (atom_pattern q))
    by (unfold atom_variables; rewrite AT; apply app_nil_r).
  assert (P : In (atom_pattern q) patterns) by now apply in_map.
  assert (VARS : forall x, In x (atom_variables q) \/ (exists g, In g (atom_guards q) /\ In x (variables g)) ->
    binds b x = true \/ In x (pattern_variables (atom_pattern q))).
  { intros x [X | (g & J & X)]; [right; now rewrite <- AV |]. specialize (G g J). rewrite forallb_forall in G.
    specialize (G x X). apply orb_true_iff in G as [G | G]; auto. right. now apply Conditions.member_iff. }
  assert (SHOWN : forall x, In x (pattern_variables (atom_pattern q)) -> b x = None -> Conditions.member x hidden = false).
  { intros x X BX. rewrite <- AV in X. destruct (AS x X) as [B | H]; auto. unfold binds in B. now rewrite BX in B. }
  (* A way that is observed has the values of the event. *)
  assert (WAY : forall bs, In bs (bindings (atom_pattern q) (content e)) -> observes q (e, extended b bs) = true ->
    forall x, b x = None -> lookup Nat.eqb bs x =
      if Conditions.member x (pattern_variables (atom_pattern q)) then found patterns (content e) x else None).
  { intros bs J O x BX. destruct (Conditions.member x (pattern_variables (atom_pattern q))) eqn:M.
    - assert (X := proj1 (Conditions.member_iff _ _) M). apply observes_iff in O as (_ & V & F & _).
      rewrite (found_fits patterns patterns_determined _ _ _ x P M F). assert (B := V x). rewrite AV in B.
      specialize (B X). unfold binds, values_of, extended in *. rewrite BX in *.
      now destruct (lookup Nat.eqb bs x).
    - destruct (lookup Nat.eqb bs x) as [v |] eqn:L; auto. apply (lookup_in Nat.eqb Nat.eqb_eq) in L.
      apply (in_map fst) in L. cbn [fst] in L. apply (bindings_names _ _ _ _ J), Conditions.member_iff in L. congruence. }
  assert (SAME : forall bs, In bs (bindings (atom_pattern q) (content e)) -> observes q (e, extended b bs) = true ->
    forall x, In x (atom_variables q) \/ (exists g, In g (atom_guards q) /\ In x (variables g)) ->
    extended b bs x = b' x).
  { intros bs J O x X. unfold extended, completed. destruct (b x) eqn:BX; auto. rewrite (WAY bs J O x BX).
    destruct (VARS x X) as [B | B]; [unfold binds in B; rewrite BX in B; discriminate |].
    rewrite (SHOWN x B BX). apply Conditions.member_iff in B. now rewrite B. }
  unfold taken. destruct (find _ _) as [c |] eqn:F.
  - apply find_some in F as [J O]. apply in_map_iff in J as (bs & <- & J).
    assert (O' : observes q (e, b') = true) by (eapply observes_same; [| exact O]; intros; now apply SAME).
    rewrite O'. eexists. split; [reflexivity |]. split.
    2:{ intros x X. apply filter_In in X as [X S]. split; [| split; [now apply Conditions.member_iff | auto]].
      unfold binds, kept. rewrite S. apply observes_iff in O as (_ & V & _). exact (V x X). }
    intros x. unfold kept, extended. destruct (b x) as [v |] eqn:BX.
    + rewrite bound_shared; auto. unfold binds. now rewrite BX.
    + rewrite (WAY bs J O x BX), AV. set (vs := pattern_variables (atom_pattern q)).
      assert (M : Conditions.member x (filter (fun x => Conditions.member x shared) vs) =
        Conditions.member x vs && Conditions.member x shared).
      { apply eq_true_iff_eq. rewrite andb_true_iff, !Conditions.member_iff, filter_In, Conditions.member_iff. tauto. }
      rewrite M. destruct (Conditions.member x shared), (Conditions.member x vs); auto.
  - destruct (observes q (e, b')) eqn:O; auto. exfalso. assert (O' := O). apply observes_iff in O as (L & V & M & _).
    apply bindings_iff in M as (bs & J & R).
    assert (K : observes q (e, extended b bs) = true).
    { eapply observes_same; [| exact O']. intros x X. unfold extended, completed. destruct (b x) eqn:BX; auto.
      destruct (VARS x X) as [B | B]; [unfold binds in B; rewrite BX in B; discriminate |].
      destruct (lookup_bound Nat.eqb Nat.eqb_eq bs x) as (v & LV); [now apply (bindings_variables _ _ _ _ J) |].
      rewrite LV. apply (lookup_in Nat.eqb Nat.eqb_eq) in LV. apply R in LV. subst v.
      assert (BB := V x). rewrite AV in BB. specialize (BB B). unfold binds, values_of, completed in *.
      rewrite BX, (SHOWN x B BX) in *. now destruct (found patterns (content e) x). }
    assert (N := find_none _ _ F (extended b bs) (in_map _ _ _ J)). simpl in N, K. congruence.
Qed.

Lemma testable_same : forall q, testable (binds b) q = testable (fun x => Conditions.member x bound) q.
Proof.
  intros q. unfold testable. f_equal. apply forallb_ext_in. intros g _. apply forallb_ext_in. intros x _.
  now rewrite bound_iff.
Qed.

Lemma test_in_sound : forall ty r, test_in bound hidden a ty = Some r -> exists r', test b e ty = Some r' /\
  match r, r' with Some l, Some c => Gets c l | None, None => True | _, _ => False end.
Proof.
  induction ty as [| | k | ty IH | ty IH ty' IH' | ty IH ty' IH']; intros r H; cbn [test_in test] in *.
  - injection H as <-. eexists; split; [reflexivity | apply gets_nothing].
  - injection H as <-. eexists; split; [reflexivity | exact I].
  - destruct (Nat.ltb_spec k first) as [K | K].
    + injection H as <-. eexists; split; [reflexivity |]. rewrite closed_letter by exact K.
      destruct (closed k e); [apply gets_nothing | exact I].
    + destruct (nth_error qs (k - first)) as [q |] eqn:N; [| injection H as <-; eexists; split; [reflexivity | exact I]].
      rewrite testable_same. destruct (testable _ q && _) eqn:T; [| discriminate]. injection H as <-.
      apply andb_true_iff in T as [T AS]. rewrite T, (atom_letter k q K N). rewrite <- testable_same in T.
      assert (TC := taken_correct q (nth_error_In _ _ N) T). rewrite forallb_forall in AS.
      assert (AS' : forall x, In x (atom_variables q) -> binds b x = true \/ Conditions.member x hidden = false).
      { intros x X. specialize (AS x X). rewrite <- bound_iff in AS. apply orb_true_iff in AS as [A | A]; auto.
        right. now apply negb_true_iff. }
      specialize (TC AS'). destruct (observes q (e, b')).
      * destruct TC as (c & -> & G). eexists; split; [reflexivity | exact G].
      * rewrite TC. eexists; split; [reflexivity | exact I].
  - rewrite (forallb_ext_in _ (binds b) (fun x => Conditions.member x bound)) by (intros; apply bound_iff).
    destruct (forallb _ _); [| discriminate]. destruct (test_in bound hidden a ty) as [q |]; [| discriminate].
    destruct (IH q eq_refl) as (q' & -> & M). destruct q, q'; try destruct M; injection H as <-;
      eexists; (split; [reflexivity |]); [exact I | apply gets_nothing].
  - destruct (test_in bound hidden a ty) as [[l |] |]; [| | discriminate];
      destruct (IH _ eq_refl) as (q' & -> & M); destruct q'; try (destruct M; fail).
    + injection H as <-. eexists; split; [reflexivity | exact M].
    + now apply IH'.
  - discriminate.
Qed.

(** The same term, and these variables have got values. *)
Definition Same (r : option (term * list nat)) (r' : option (term * assignment)) : Prop :=
  match r, r' with
  | Some p, Some p' => fst p = fst p' /\ Gets (snd p') (snd p)
  | None, None => True
  | _, _ => False
  end.

Lemma go_in_sound : forall depth x r, go_in bound hidden a depth x = Some r -> exists r', Goes e b x r' /\ Same r r'.
Proof.
  assert (MAP : forall (f : term -> term) r r', Same r r' ->
    Same (option_map (fun p => (f (fst p), snd p)) r) (option_map (fun p => (f (fst p), snd p)) r')).
  { intros f [[y l] |] [[y' c] |]; simpl; auto. intros [-> G]; auto. }
  induction depth as [| depth IH]; intros x r H; [discriminate |].
  destruct x as [| | | ty | x y | x y | x y | x y | ty x y | x | x | n]; cbn [go_in] in H.
  - injection H as <-. eexists; split; [constructor | split; [reflexivity | apply gets_nothing]].
  - injection H as <-. exists None; split; [constructor | exact I].
  - injection H as <-. exists None; split; [constructor | exact I].
  - destruct (test_in bound hidden a ty) as [q |] eqn:T; [| discriminate]. injection H as <-.
    destruct (test_in_sound ty q T) as (q' & T' & M). exists (option_map (pair Empty) q'). split; [now constructor |].
    destruct q, q'; simpl; auto.
  - destruct (go_in bound hidden a depth x) as [[p |] |] eqn:X; [| | discriminate];
      destruct (IH _ _ X) as ([p' |] & G & M); try (destruct M; fail).
    + injection H as <-. eexists. split; [apply goes_first, G |].
      exact (MAP (fun x' => then_ x' y) (Some p) (Some p') M).
    + destruct (halts_in equations depth x) as [[] |] eqn:Z; try discriminate; apply halts_in_sound in Z.
      * destruct (IH _ _ H) as (r' & G' & M'). exists r'. split; auto. now apply goes_second.
      * injection H as <-. exists None. split; auto. now apply goes_neither.
  - destruct (go_in bound hidden a depth x) as [[p |] |] eqn:X; [| | discriminate];
      destruct (IH _ _ X) as ([p' |] & G & M); try (destruct M; fail).
    + injection H as <-. exists (Some p'). split; [now apply goes_left | exact M].
    + destruct (IH _ _ H) as (r' & G' & M'). exists r'. split; auto. now apply goes_right.
  - destruct (go_in bound hidden a depth x) as [[[x' c] |] |] eqn:X.
    + destruct (go_in bound hidden a depth y) as [[[y' d] |] |] eqn:Y; [| | discriminate]; injection H as <-.
      * destruct (IH _ _ X) as ([[x0 c'] |] & G & M); [| destruct M]. destruct M as [M0 M]; cbn [fst snd] in M0, M; subst x0.
        destruct (IH _ _ Y) as ([[y0 d'] |] & G' & M'); [| destruct M']. destruct M' as [M0 M']; cbn [fst snd] in M0, M'; subst y0.
        destruct (gets_merged c' d' c d M M') as [C D]. exists (Some (joined x' y', merged c' d')).
        split; [now apply goes_both | now split].
      * destruct (IH _ _ Y) as ([p' |] & G & M); [destruct M |]. exists None. split; auto. now apply goes_not_right.
    + injection H as <-. destruct (IH _ _ X) as ([p' |] & G & M); [destruct M |]. exists None. split; auto.
      now apply goes_not_left.
    + destruct (go_in bound hidden a depth y) as [[[y' d] |] |] eqn:Y; try discriminate. injection H as <-.
      destruct (IH _ _ Y) as ([p' |] & G & M); [destruct M |]. exists None. split; auto. now apply goes_not_right.
  - destruct (go_in bound hidden a depth x) as [[p |] |] eqn:X; [| | discriminate];
      destruct (IH _ _ X) as ([p' |] & G & M); try (destruct M; fail).
    + injection H as <-. eexists. split; [apply goes_shuffle_left, G |].
      exact (MAP (fun x' => shuffled x' y) (Some p) (Some p') M).
    + destruct (go_in bound hidden a depth y) as [q |] eqn:Y; [| discriminate]. injection H as <-.
      destruct (IH _ _ Y) as (q' & G' & M'). eexists. split; [apply goes_shuffle_right; eauto |]. exact (MAP (shuffled x) _ _ M').
  - destruct (type_variables ty) eqn:V; [| discriminate].
    destruct (test_in bound hidden a ty) as [[l |] |] eqn:T; [| | discriminate];
      destruct (test_in_sound ty _ T) as ([c |] & T' & M); try (destruct M; fail); clear M.
    + destruct (go_in bound hidden a depth x) as [q |] eqn:X; [| discriminate]. injection H as <-.
      destruct (IH _ _ X) as (q' & G' & M'). eexists. split; [eapply goes_inside; eauto |]. exact (MAP (fun x' => filtered ty x' y) _ _ M').
    + destruct (go_in bound hidden a depth y) as [q |] eqn:Y; [| discriminate]. injection H as <-.
      destruct (IH _ _ Y) as (q' & G' & M'). eexists. split; [eapply goes_outside; eauto |]. exact (MAP (filtered ty x) _ _ M').
  - destruct (go_in bound hidden a depth x) as [q |] eqn:X; [| discriminate]. injection H as <-.
    destruct (IH _ _ X) as (q' & G' & M'). eexists. split; [apply goes_star; eauto |]. exact (MAP (fun x' => then_ x' (Star x)) _ _ M').
  - destruct (IH _ _ H) as (r' & G & M). exists r'. split; auto. now constructor.
  - destruct (IH _ _ H) as (r' & G & M). exists r'. split; auto. now constructor.
Qed.
End Soundness.
End Rules.
