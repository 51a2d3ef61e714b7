(** * The deterministic automaton of plain scenarios

    It reads letters, the sets of predicates that hold at an event.  A state has, for each scenario,
    the sets of occurrences that may be done.  Its verdicts are those of the definition under all four
    semantics.  Under [scattered], a done set within another one is left out. *)

Require Import List Bool Arith Lia Permutation.
Require Import RVAFT.Language RVAFT.Definition RVAFT.Search RVAFT.Plain.
Import ListNotations.

(** ** Letters *)

Definition letter := list nat.

Definition member (p : nat) (a : letter) : bool := existsb (Nat.eqb p) a.

Lemma member_iff : forall p a, member p a = true <-> In p a.
Proof.
  unfold member; intros; rewrite existsb_exists; split.
  - intros (x & H & K). now apply Nat.eqb_eq in K as ->.
  - intros H; exists p; split; auto using Nat.eqb_refl.
Qed.

(** The predicates that scenarios use, with relevance. *)
Definition alphabet (xs : list shape) : list nat :=
  relevance :: flat_map (fun x => map (requirement x) (shape_occurrences x)) xs.

(** ** Done sets *)

Definition done_set := list occurrence.

(** A row of a scenario: an occurrence, the predicate that it requires, and the occurrences before it. *)
Record row := Row { row_of : occurrence; needs : nat; predecessors : list occurrence }.
Definition rows (x : shape) : list row :=
  map (fun o => Row o (requirement x o) (filter (fun p => shape_before x p o) (shape_occurrences x)))
      (shape_occurrences x).

(** The occurrence of a row becomes done, in the order of the rows. *)
Definition put (table : list row) (o : occurrence) (d : done_set) : done_set :=
  filter (fun p => same p o || among p d) (map row_of table).

Definition successors (table : list row) (a : letter) (d : done_set) : list done_set :=
  flat_map (fun r => if member (needs r) a && negb (among (row_of r) d) && forallb (fun p => among p d) (predecessors r)
                     then [put table (row_of r) d] else []) table.

Fixpoint compare_done (d d' : done_set) : comparison :=
  match d, d' with
  | [], [] => Eq
  | [], _ => Lt
  | _, [] => Gt
  | (n, i) :: d, (n', i') :: d' =>
    match Nat.compare n n' with
    | Eq => match Nat.compare i i' with Eq => compare_done d d' | c => c end
    | c => c
    end
  end.

Definition same_done (d d' : done_set) : bool := match compare_done d d' with Eq => true | _ => false end.

(** The second done set can do whatever the first can. *)
Definition below (s : semantics) (d d' : done_set) : bool :=
  match s with
  | Scattered => forallb (fun o => among o d') d
  | Strict | Projected | Consecutive => same_done d d'
  end.

Definition keep (s : semantics) (d : done_set) (l : list done_set) : list done_set :=
  if existsb (below s d) l then l else d :: filter (fun d' => negb (below s d' d)) l.

Fixpoint insert (d : done_set) (l : list done_set) : list done_set :=
  match l with
  | [] => [d]
  | d' :: l' => match compare_done d d' with Gt => d' :: insert d l' | _ => d :: l end
  end.

(** A normal form: without done sets that another one covers, and sorted. *)
Definition tidy (s : semantics) (l : list done_set) : list done_set :=
  fold_right insert [] (fold_right (keep s) [] l).

(** ** The automaton *)

Definition advance_sets (s : semantics) (a : letter) (table : list row) (ds : list done_set) : list done_set :=
  match s with
  | Strict => tidy s (flat_map (successors table a) ds)
  | Projected => if member relevance a then tidy s (flat_map (successors table a) ds) else ds
  | Consecutive => if member relevance a then tidy s ([] :: flat_map (successors table a) ds) else ds
  | Scattered => tidy s (ds ++ flat_map (successors table a) ds)
  end.

Definition all_done (table : list row) (d : done_set) : bool := forallb (fun r => among (row_of r) d) table.

Inductive state := Accepting | Watching (sets : list (list done_set)).

Fixpoint map2 {A B C} (f : A -> B -> C) (l : list A) (m : list B) : list C :=
  match l, m with a :: l, b :: m => f a b :: map2 f l m | _, _ => [] end.

Definition settled (tables : list (list row)) (sets : list (list done_set)) : state :=
  if existsb (fun b => b) (map2 (fun table ds => existsb (all_done table) ds) tables sets)
  then Accepting else Watching sets.

Definition initial (tables : list (list row)) : state := settled tables (map (fun _ => [[]]) tables).

Definition delta (s : semantics) (tables : list (list row)) (q : state) (a : letter) : state :=
  match q with
  | Accepting => Accepting
  | Watching sets => settled tables (map2 (advance_sets s a) tables sets)
  end.

Definition verdict_at (q : state) : verdict :=
  match q with Accepting => Top | Watching sets => if forallb is_nil sets then Bottom else Unknown end.

(** ** Normal forms *)

Lemma compare_done_eq : forall d d', compare_done d d' = Eq -> d = d'.
Proof.
  induction d as [| [n i] d IH]; destruct d' as [| [n' i'] d']; simpl; try discriminate; auto.
  destruct (Nat.compare_spec n n'); try discriminate. destruct (Nat.compare_spec i i'); try discriminate.
  intros C; apply IH in C; congruence.
Qed.

Lemma compare_done_refl : forall d, compare_done d d = Eq.
Proof. induction d as [| [n i] d IH]; simpl; auto. now rewrite !Nat.compare_refl. Qed.

Lemma same_done_iff : forall d d', same_done d d' = true <-> d = d'.
Proof.
  intros d d'; unfold same_done; split.
  - destruct (compare_done d d') eqn:C; try discriminate. intros _; now apply compare_done_eq.
  - intros ->. now rewrite compare_done_refl.
Qed.

Lemma below_iff : forall s d d', below s d d' = true <-> match s with Scattered => incl d d' | _ => d = d' end.
Proof.
  intros s d d'; destruct s; simpl; try apply same_done_iff. rewrite forallb_forall. unfold incl.
  split; intros H o I; apply H in I; now apply among_iff.
Qed.

Lemma below_refl : forall s d, below s d d = true.
Proof. intros; apply below_iff; destruct s; auto using incl_refl. Qed.

Lemma below_trans : forall s a b c, below s a b = true -> below s b c = true -> below s a c = true.
Proof. intros s a b c; rewrite !below_iff; destruct s; try congruence. intros; eapply incl_tran; eauto. Qed.

Lemma in_insert : forall d l x, In x (insert d l) <-> x = d \/ In x l.
Proof.
  induction l as [| d' l IH]; simpl; intros x; [intuition congruence |].
  destruct (compare_done d d'); simpl; rewrite ?IH; intuition congruence.
Qed.

Lemma in_sorted : forall l x, In x (fold_right insert [] l) <-> In x l.
Proof. induction l; simpl; intros; [tauto |]. rewrite in_insert, IHl. intuition congruence. Qed.

Lemma tidy_within : forall s l d, In d (tidy s l) -> In d l.
Proof.
  intros s l d; unfold tidy; rewrite in_sorted. induction l as [| x l IH]; simpl; auto.
  unfold keep. destruct (existsb _ _); auto. intros [H | H]; auto. apply filter_In in H as [H _]; auto.
Qed.

Lemma tidy_covers : forall s l d, In d l -> exists d', In d' (tidy s l) /\ below s d d' = true.
Proof.
  intros s l d I.
  assert (K : exists d', In d' (fold_right (keep s) [] l) /\ below s d d' = true).
  { induction l as [| x l IH]; simpl; [destruct I |]. unfold keep at 1.
    destruct (existsb (below s x) (fold_right (keep s) [] l)) eqn:X.
    - destruct I as [-> | I]; auto. apply existsb_exists in X; exact X.
    - destruct I as [-> | I]; [exists d; simpl; auto using below_refl |].
      destruct (IH I) as (d' & J & B). destruct (below s d' x) eqn:C.
      + exists x; simpl; split; auto. eapply below_trans; eauto.
      + exists d'; split; auto. right. apply filter_In. now rewrite C. }
  destruct K as (d' & J & B). exists d'; split; auto. now apply in_sorted.
Qed.

(** ** The done sets are those of the search *)

Section Automaton.
Context {E : Type}.
Variable satisfies : nat -> E -> bool.
Notation relevant := (relevant satisfies).
Notation Rel := (fun e => relevant e = true).
Notation plain := (plain satisfies).

(** The letter of an event over some predicates. *)
Definition letter_of (predicates : list nat) (e : E) : letter := filter (fun p => satisfies p e) predicates.

Lemma member_letter : forall ps p e, In p ps -> member p (letter_of ps e) = satisfies p e.
Proof. intros ps p e I. apply eq_true_iff_eq. rewrite member_iff. unfold letter_of. rewrite filter_In. tauto. Qed.

Variable predicates : list nat.
Notation reads := (letter_of predicates).

Definition canon (x : shape) (d : list occurrence) : done_set := filter (fun o => among o d) (shape_occurrences x).

Lemma canon_agree : forall x d, agree x (canon x d) d.
Proof. intros x d p I; unfold canon. rewrite filter_In, among_iff. tauto. Qed.

Lemma canon_same : forall x d d', agree x d d' -> canon x d = canon x d'.
Proof.
  intros x d d' H. unfold canon. apply filter_ext_in. intros p I. now apply agree_among with x.
Qed.

Lemma occurrences_of_rows : forall x, map row_of (rows x) = shape_occurrences x.
Proof. intros; unfold rows. rewrite map_map; simpl. apply map_id. Qed.

Lemma put_canon : forall x o d, put (rows x) o d = canon x (o :: d).
Proof. intros; unfold put, canon. rewrite occurrences_of_rows. apply filter_ext. intros; simpl; auto. Qed.

Lemma forallb_filter : forall (A : Type) (f g : A -> bool) l,
  forallb f (filter g l) = forallb (fun a => implb (g a) (f a)) l.
Proof. induction l as [| a l IH]; simpl; auto. destruct (g a); simpl; now rewrite IH. Qed.

Lemma in_successors : forall x e d d', incl (map (requirement x) (shape_occurrences x)) predicates ->
  (In d' (successors (rows x) (reads e) d) <-> exists o, In o (shape_occurrences x) /\ ready x d o = true /\
     satisfies (requirement x o) e = true /\ d' = canon x (o :: d)).
Proof.
  intros x e d d' A. unfold successors. rewrite in_flat_map.
  assert (B : forall o, In o (shape_occurrences x) ->
    member (requirement x o) (reads e) && negb (among o d)
      && forallb (fun p => among p d) (filter (fun p => shape_before x p o) (shape_occurrences x))
    = satisfies (requirement x o) e && ready x d o).
  { intros o I. rewrite member_letter by (apply A, in_map; auto). unfold ready. rewrite andb_assoc. f_equal.
    apply forallb_filter. }
  split.
  - intros (r & I & J). unfold rows in I. apply in_map_iff in I as (o & <- & I). simpl in J. rewrite B in J by auto.
    destruct (satisfies (requirement x o) e) eqn:S, (ready x d o) eqn:R; simpl in J; try tauto.
    destruct J as [<- | []]. exists o; rewrite put_canon; auto.
  - intros (o & I & R & S & ->). eexists; split; [apply in_map, I |]. simpl. rewrite B, R, S by auto. simpl.
    left; apply put_canon.
Qed.

(** The done sets are those of partial matches, and each partial match has a done set that can do
    whatever it can. *)
Definition covers (s : semantics) (x : shape) (ds : list done_set) (ms : list (assigned E)) : Prop :=
  (forall d, In d ds -> exists m, In m ms /\ canon x (domain m) = d) /\
  (forall m, In m ms -> exists d, In d ds /\ below s (canon x (domain m)) d = true).

Lemma covers_app : forall s x ds ds' ms ms', covers s x ds ms -> covers s x ds' ms' ->
  covers s x (ds ++ ds') (ms ++ ms').
Proof.
  intros s x ds ds' ms ms' [A B] [A' B']; split.
  - intros d I. apply in_app_iff in I as [I | I]; [apply A in I | apply A' in I];
      destruct I as (m & I & Q); exists m; split; auto; apply in_app_iff; auto.
  - intros m I. apply in_app_iff in I as [I | I]; [apply B in I | apply B' in I];
      destruct I as (d & I & Q); exists d; split; auto; apply in_app_iff; auto.
Qed.

Lemma covers_tidy : forall s x ds ms, covers s x ds ms -> covers s x (tidy s ds) ms.
Proof.
  intros s x ds ms [A B]; split.
  - intros d I. apply tidy_within in I; auto.
  - intros m I. destruct (B m I) as (d & J & Q). destruct (tidy_covers s ds d J) as (d' & K & R).
    exists d'; split; auto. eapply below_trans; eauto.
Qed.

Lemma covers_start : forall s x, covers s x [[]] (start (plain x)).
Proof.
  intros s x. assert (Q : canon x [] = []) by (unfold canon; simpl; induction (shape_occurrences x); auto).
  unfold start; simpl. split.
  - intros d [<- | []]. exists []; simpl; auto.
  - intros m [<- | []]. exists []; simpl domain. rewrite Q. split; simpl; auto. apply below_refl.
Qed.

Definition well_lettered (x : shape) : Prop := incl (map (requirement x) (shape_occurrences x)) predicates.

Lemma successors_sound : forall s x e ds ms, well_lettered x -> Consistents satisfies x ms -> covers s x ds ms ->
  forall d, In d (flat_map (successors (rows x) (reads e)) ds) ->
  exists m, In m (flat_map (extend (plain x) e) ms) /\ canon x (domain m) = d.
Proof.
  intros s x e ds ms W C [A _] d I. apply in_flat_map in I as (d0 & I0 & I). apply A in I0 as (m0 & I0 & <-).
  apply in_successors in I as (o & O & R & S & ->); auto. exists ((o, e) :: m0); split.
  - apply in_flat_map; exists m0; split; auto. apply in_extend_plain; auto. exists o; repeat split; auto.
    rewrite <- R. symmetry. apply ready_agree; auto. apply canon_agree.
  - simpl. apply canon_same. intros p J; simpl. now rewrite (canon_agree x (domain m0) p J).
Qed.

Lemma successors_complete : forall s x e ds ms, well_lettered x -> Consistents satisfies x ms -> covers s x ds ms ->
  forall m, In m (flat_map (extend (plain x) e) ms) ->
  exists d, (In d (flat_map (successors (rows x) (reads e)) ds) \/ (s = Scattered /\ In d ds)) /\
            below s (canon x (domain m)) d = true.
Proof.
  intros s x e ds ms W C [_ B] m I. apply in_flat_map in I as (m0 & I0 & I). destruct (B m0 I0) as (d & J & L).
  apply in_extend_plain in I as (o & -> & O & R & S); auto.
  assert (K : forall d, In d ds -> ready x d o = true ->
    In (canon x (o :: d)) (flat_map (successors (rows x) (reads e)) ds)).
  { intros d' J' R'. apply in_flat_map; exists d'; split; auto. apply in_successors; eauto. }
  rewrite below_iff in L. simpl domain.
  assert (Q : s <> Scattered -> d = canon x (domain m0)) by (destruct s; congruence).
  assert (Z : s = Scattered -> incl (canon x (domain m0)) d) by (intros ->; exact L).
  clear L. destruct (match s with Scattered => true | _ => false end) eqn:SC.
  - destruct s; try discriminate. specialize (Z eq_refl). destruct (among o d) eqn:M.
    + exists d; split; auto. apply below_iff. intros p P. unfold canon in P. apply filter_In in P as [P P'].
      apply among_iff in P' as [<- | P']; [now apply among_iff |]. apply Z. now apply canon_agree.
    + exists (canon x (o :: d)); split.
      * left. apply K; auto. unfold ready in *. rewrite M; simpl. apply andb_true_iff in R as [_ R].
        rewrite forallb_forall in *. intros p P. specialize (R p P). destruct (shape_before x p o); simpl in *; auto.
        apply among_iff in R. apply among_iff, Z. now apply canon_agree.
      * apply below_iff. intros p P. unfold canon in P. apply filter_In in P as [P P']. apply filter_In; split; auto.
        apply among_iff in P' as [<- | P']; apply among_iff; simpl; auto. right. apply Z. now apply canon_agree.
  - assert (d = canon x (domain m0)) by (apply Q; destruct s; discriminate). subst d.
    exists (canon x (o :: domain m0)); split.
    + left. replace (canon x (o :: domain m0)) with (canon x (o :: canon x (domain m0))).
      * apply K; auto. rewrite <- R. apply ready_agree; auto. apply canon_agree.
      * apply canon_same. intros p P; simpl. now rewrite (canon_agree x (domain m0) p P).
    + apply below_refl.
Qed.

Lemma covers_step : forall s x e ds ms, In relevance predicates -> well_lettered x -> Consistents satisfies x ms ->
  covers s x ds ms -> covers s x (advance_sets s (reads e) (rows x) ds) (step relevant s (plain x) e ms).
Proof.
  intros s x e ds ms A W C H.
  assert (N : s <> Scattered ->
    covers s x (flat_map (successors (rows x) (reads e)) ds) (flat_map (extend (plain x) e) ms)).
  { intros NS. split; [now apply successors_sound with s |]. intros m I.
    destruct (successors_complete s x e ds ms W C H m I) as (d & [J | [J _]] & L); [eauto | contradiction]. }
  assert (M : member relevance (reads e) = relevant e) by now apply member_letter.
  unfold advance_sets, step; destruct s; rewrite ?M.
  - apply covers_tidy, N; discriminate.
  - destruct (relevant e); auto. apply covers_tidy, N; discriminate.
  - destruct (relevant e); auto. apply covers_tidy, (covers_app _ _ [[]]); [apply covers_start | apply N; discriminate].
  - apply covers_tidy. split.
    + intros d I. apply in_app_iff in I as [I | I].
      * apply H in I as (m & I & Q). exists m; split; auto. apply in_app_iff; auto.
      * apply (successors_sound Scattered x e ds ms) in I as (m & I & Q); auto. exists m; split; auto.
        apply in_app_iff; auto.
    + intros m I. apply in_app_iff in I as [I | I].
      * apply H in I as (d & I & Q). exists d; split; auto. apply in_app_iff; auto.
      * destruct (successors_complete Scattered x e ds ms W C H m I) as (d & [J | [_ J]] & L);
          exists d; split; auto; apply in_app_iff; auto.
Qed.

Lemma all_done_rows : forall x d, all_done (rows x) d = finished x d.
Proof. intros; unfold all_done, rows, finished. now rewrite forallb_map. Qed.

Lemma covers_full : forall s x ds ms, covers s x ds ms -> existsb (all_done (rows x)) ds = existsb (full (plain x)) ms.
Proof.
  intros s x ds ms [A B]. apply eq_true_iff_eq. rewrite !existsb_exists. split.
  - intros (d & I & F). apply A in I as (m & I & <-). exists m; split; auto. rewrite all_done_rows in F.
    rewrite full_finished. rewrite <- F. symmetry. apply finished_agree, canon_agree.
  - intros (m & I & F). destruct (B m I) as (d & J & L). exists d; split; auto. rewrite all_done_rows.
    rewrite full_finished in F. unfold finished in *. rewrite forallb_forall in *. intros o O. apply among_iff.
    apply below_iff in L. assert (X : In o (canon x (domain m))) by (apply canon_agree, among_iff; auto).
    destruct s; try (rewrite <- L; exact X). now apply L.
Qed.

Lemma covers_nil : forall s x ds ms, covers s x ds ms -> is_nil ds = is_nil ms.
Proof.
  intros s x [| d ds] [| m ms] [A B]; auto.
  - destruct (B m) as (d & [] & _); simpl; auto.
  - destruct (A d) as (m & [] & _); simpl; auto.
Qed.

(** ** The verdict of the automaton is the verdict of the definition *)

Definition sets_after s x u := fold_left (fun ds e => advance_sets s (reads e) (rows x) ds) u [[]].

Lemma states_consistent : forall s x u, Consistents satisfies x (states relevant s (plain x) u).
Proof.
  intros s x u m I. apply states_sound in I as (pos & P & _); [| apply plain_lawful]. apply (conditions_hold _ _ _ _ P).
Qed.

Lemma sets_cover : forall s x u, In relevance predicates -> well_lettered x ->
  covers s x (sets_after s x u) (states relevant s (plain x) u).
Proof.
  intros s x u A W; induction u as [| e u IH] using rev_ind; [apply covers_start |].
  unfold sets_after. rewrite fold_left_app, states_snoc. simpl. apply covers_step; auto. apply states_consistent.
Qed.

Lemma map2_map : forall (A B C D : Type) (f : A -> B -> C) (g : D -> A) (h : D -> B) l,
  map2 f (map g l) (map h l) = map (fun d => f (g d) (h d)) l.
Proof. induction l; simpl; congruence. Qed.

Lemma existsb_ext_in : forall (A : Type) (f g : A -> bool) l, (forall a, In a l -> f a = g a) ->
  existsb f l = existsb g l.
Proof. induction l; simpl; intros H; auto. rewrite H, IHl; auto. Qed.

Definition letters (u : list E) : list letter := map reads u.
Definition automaton_after s xs u : state := fold_left (delta s (map rows xs)) (letters u) (initial (map rows xs)).

Lemma settled_after : forall s xs u, settled (map rows xs) (map (fun x => sets_after s x u) xs) =
  if existsb (fun x => existsb (all_done (rows x)) (sets_after s x u)) xs then Accepting
  else Watching (map (fun x => sets_after s x u) xs).
Proof. intros; unfold settled. now rewrite map2_map, existsb_map. Qed.

(** The automaton is done exactly when the search is; before, it has the done sets of each scenario. *)
Lemma automaton_run : forall s xs u, In relevance predicates -> Forall well_lettered xs ->
  (automaton_after s xs u = Accepting /\ run relevant s (map plain xs) u = Done) \/
  (automaton_after s xs u = Watching (map (fun x => sets_after s x u) xs) /\
   run relevant s (map plain xs) u = Running (snapshot relevant s (map plain xs) u)).
Proof.
  intros s xs u A W. rewrite Forall_forall in W.
  assert (F : forall u, existsb (fun x => existsb (all_done (rows x)) (sets_after s x u)) xs =
     existsb (fun c => existsb (full c) (states relevant s c u)) (map plain xs)).
  { intros v. rewrite existsb_map. apply existsb_ext_in. intros x I. apply covers_full with s, sets_cover; auto. }
  unfold automaton_after, letters. induction u as [| e u IH] using rev_ind.
  - simpl. change (run relevant s (map plain xs) []) with (settle (snapshot relevant s (map plain xs) [])).
    unfold initial. rewrite map_map, settle_snapshot, <- F.
    change (map (fun _ : shape => [[]]) xs) with (map (fun x => sets_after s x []) xs). rewrite settled_after.
    destruct (existsb _ xs); auto.
  - rewrite map_app, fold_left_app, run_snoc. destruct IH as [[-> ->] | [-> ->]]; [left; auto |].
    simpl. rewrite map2_map.
    replace (map (fun x => advance_sets s (reads e) (rows x) (sets_after s x u)) xs)
      with (map (fun x => sets_after s x (u ++ [e])) xs)
      by (apply map_ext; intros; unfold sets_after; now rewrite fold_left_app).
    rewrite <- snapshot_snoc, settle_snapshot, settled_after, <- F. destruct (existsb _ xs); auto.
Qed.

Theorem automaton_verdict : forall s xs u, In relevance predicates -> Forall well_lettered xs ->
  verdict_at (automaton_after s xs u) = verdict_of (run relevant s (map plain xs) u).
Proof.
  intros s xs u A W. destruct (automaton_run s xs u A W) as [[-> ->] | [-> ->]]; auto.
  simpl. unfold snapshot. rewrite !forallb_map.
  rewrite (forallb_ext_in _ (fun x => is_nil (snd (plain x, states relevant s (plain x) u)))
             (fun x => is_nil (sets_after s x u))); auto.
  intros x I. simpl. symmetry. apply covers_nil with s x, sets_cover; auto. rewrite Forall_forall in W; auto.
Qed.

(** The automaton has the verdict of the definition after every trace, under every semantics. *)
Theorem automaton_correct : forall s xs u, In relevance predicates -> Forall well_lettered xs ->
  Verdict Rel (Scenarios (map plain xs)) s u (verdict_at (automaton_after s xs u)).
Proof. intros. rewrite automaton_verdict by auto. apply verdict_correct, all_lawful. Qed.

Theorem automaton_accepts : forall s xs u, In relevance predicates -> Forall well_lettered xs ->
  (automaton_after s xs u = Accepting <-> Detected Rel (Scenarios (map plain xs)) s u).
Proof.
  intros s xs u A W. pose proof (automaton_correct s xs u A W) as V.
  destruct (automaton_after s xs u) as [| sets]; simpl in V; [tauto |].
  destruct (forallb is_nil sets); simpl in V; (split; [discriminate | tauto]).
Qed.
End Automaton.

Lemma alphabet_lettered : forall xs, In relevance (alphabet xs) /\ Forall (well_lettered (alphabet xs)) xs.
Proof.
  intros xs; split; [simpl; auto |]. apply Forall_forall. intros x I p J. right. apply in_flat_map; eauto.
Qed.
