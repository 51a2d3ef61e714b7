(** * The short LTLf texts of gates over leaves

    [sand] is a chain.  [and] and votes are conjunctions, thresholds and windows, provided that no event
    serves two of the leaves.  The texts are those that are emitted. *)

Require Import List Bool Arith Lia.
Require Import RVAFT.Language RVAFT.Definition RVAFT.Search RVAFT.Plain RVAFT.Acceptance RVAFT.Ltlf.
Import ListNotations.

Section Gates.
Context {E : Type}.
Variable satisfies : nat -> E -> bool.
Notation relevant := (relevant satisfies).
Notation Rel := (fun e => relevant e = true).
Notation plain := (plain satisfies).
Notation Detected s xs := (Detected Rel (Scenarios (map plain xs)) s).
Notation Completes := (Completes satisfies).
Notation holds := (holds satisfies).

(** ** [sand]: a chain *)

(** The occurrences are listed in their precedence, which is total. *)
Definition sequence (x : shape) : Prop :=
  NoDup (shape_occurrences x) /\
  forall l o m, shape_occurrences x = l ++ o :: m ->
    (forall p, In p l -> shape_before x p o = true) /\ (forall p, In p (o :: m) -> shape_before x p o = false).

(** [p & X[!](q & X[!] r)]; under [scattered] [F(p & X[!] F(q & X[!] F r))]. *)
Fixpoint chain (s : semantics) (ps : list nat) : formula :=
  match ps with
  | [] => Falsity
  | [p] => await s (Atom p)
  | p :: ps => await s (Conj (Atom p) (Next (chain s ps)))
  end.

Lemma chain_cons : forall s p ps,
  chain s (p :: ps) = await s (followed p (match ps with [] => None | _ => Some (chain s ps) end)).
Proof. intros s p [| q ps]; reflexivity. Qed.

Lemma chain_nil : forall s ps, holds (chain s ps) [] = false.
Proof. intros s [| p [| q ps]]; destruct s; reflexivity. Qed.

Lemma followed_nil : forall p after, holds (followed p after) [] = false.
Proof. intros p [f |]; reflexivity. Qed.

Lemma sequence_ready : forall x l o m, sequence x -> shape_occurrences x = l ++ o :: m ->
  forall p, In p (shape_occurrences x) -> (ready x l p = true <-> p = o).
Proof.
  intros x l o m [N B] Q p I. unfold ready. rewrite andb_true_iff, negb_true_iff, forallb_forall. split.
  - intros [A R]. rewrite Q, in_app_iff in I. simpl in I. destruct I as [I | [<- | I]]; auto.
    + apply among_iff in I; congruence.
    + exfalso. apply in_split in I as (l1 & l2 & ->).
      destruct (B (l ++ o :: l1) p l2) as [P _]; [rewrite <- app_assoc; exact Q |].
      assert (X : among o l = true).
      { assert (O : In o (shape_occurrences x)) by (rewrite Q; apply in_app_iff; simpl; auto).
        specialize (R o O). rewrite P in R by (apply in_app_iff; simpl; auto). exact R. }
      apply among_iff in X. rewrite Q in N. apply NoDup_remove_2 in N. apply N, in_app_iff; auto.
  - intros ->. rewrite Q in N. apply NoDup_remove_2 in N. destruct (B l o m Q) as [P F]. split.
    + apply not_true_is_false. rewrite among_iff. intros J; apply N, in_app_iff; auto.
    + intros q J. rewrite Q, in_app_iff in J. destruct J as [J | J].
      * rewrite P by auto. simpl. now apply among_iff.
      * now rewrite F.
Qed.

Lemma finished_all : forall x done, finished x done = true <-> incl (shape_occurrences x) done.
Proof.
  intros; unfold finished; rewrite forallb_forall. unfold incl.
  split; intros H o I; apply H in I; now apply among_iff.
Qed.

Lemma chain_completes : forall s x, s = Strict \/ s = Scattered -> sequence x -> forall m l u,
  m <> [] -> shape_occurrences x = l ++ m ->
  (holds (chain s (map (requirement x) m)) u = true <-> Completes s x l u).
Proof.
  intros s x S X; induction m as [| o m IH]; [congruence |]. intros l u _ Q.
  assert (R := sequence_ready x l o m X Q).
  assert (F : finished x l = false).
  { apply not_true_is_false. rewrite finished_all. intros A. destruct X as [N _]. rewrite Q in *.
    apply NoDup_remove_2 in N. apply N, in_app_iff. left. apply A, in_app_iff; simpl; auto. }
  assert (O : In o (shape_occurrences x)) by (rewrite Q; apply in_app_iff; simpl; auto).
  assert (A : agree x (l ++ [o]) (o :: l)) by (intros p _; rewrite in_app_iff; simpl; tauto).
  assert (A' : agree x (o :: l) (l ++ [o])) by (intros p _; rewrite in_app_iff; simpl; tauto).
  cbn [map]. rewrite chain_cons, holds_await by auto using followed_nil. rewrite completes_step by exact F.
  set (after := match map _ m with [] => None | _ => _ end).
  assert (K : forall w, match after with Some f => holds f w | None => true end = true <-> Completes s x (o :: l) w).
  { intros w. unfold after. destruct m as [| o' m'].
    - simpl. split; auto. intros _. apply completed. apply finished_all. rewrite Q. intros p J.
      apply in_app_iff in J as [J | [<- | []]]; simpl; auto.
    - cbn [map]. change (requirement x o' :: map (requirement x) m') with (map (requirement x) (o' :: m')).
      rewrite (IH (l ++ [o])); [| discriminate | now rewrite <- app_assoc].
      split; apply completes_agree; auto. }
  assert (CO : forall e, counts satisfies s e = true) by (destruct S as [-> | ->]; auto).
  assert (RD : ready x l o = true) by now apply R.
  assert (Z : forall f, after = Some f -> holds f [] = false).
  { unfold after. intros f J. assert (f = chain s (map (requirement x) m)) as ->; [| apply chain_nil].
    destruct (map (requirement x) m); congruence. }
  split.
  - intros (v & e & w & -> & V & H). rewrite holds_followed, andb_true_iff, K in H by exact Z.
    destruct H as [P C]. exists v, e, w, o; auto 10.
  - intros (v & e & w & p & -> & V & _ & I & RP & P & C). apply R in RP as ->; auto.
    exists v, e, w; repeat split; auto. rewrite holds_followed, andb_true_iff, K by exact Z. auto.
Qed.

Definition chain_text (s : semantics) (ps : list nat) : formula := text_of s (chain (base s) ps).

Lemma bounded_chain : forall ps, bounded (chain Strict ps) = true.
Proof. induction ps as [| p [| q ps] IH]; auto. Qed.

(** The text of a sequence accepts the traces with a detection, under all four semantics. *)
Theorem chain_text_correct : forall s x, sequence x -> shape_occurrences x <> [] -> forall u,
  holds (chain_text s (map (requirement x) (shape_occurrences x))) u = true <-> Detected s [x] u.
Proof.
  intros s x X N u.
  assert (B : forall b u, b = Strict \/ b = Scattered ->
    (holds (chain b (map (requirement x) (shape_occurrences x))) u = true <-> Detected b [x] u)).
  { intros b w Q. rewrite detected_base, (chain_completes b x Q X _ [] w N) by auto. split.
    - intros K; exists x; simpl; auto.
    - intros (y & [<- | []] & K); auto. }
  destruct s; unfold chain_text; simpl base; try (apply B; auto);
    apply text_of_correct; auto using bounded_chain, chain_nil; discriminate.
Qed.

(** ** Votes and [and] over leaves *)

Fixpoint sublists {A} (l : list A) : list (list A) :=
  match l with [] => [[]] | a :: l => map (cons a) (sublists l) ++ sublists l end.

Lemma in_sublists : forall A (l m : list A), In m (sublists l) <-> Sublist m l.
Proof.
  induction l as [| a l IH]; simpl; intros m.
  - split; [intros [<- | []]; constructor | intros H; inversion H; auto].
  - rewrite in_app_iff, in_map_iff, IH. split.
    + intros [(m' & <- & I) | I]; [constructor; now apply IH | now constructor].
    + intros H; inversion H; subst; auto. left; eexists; split; eauto. now apply IH.
Qed.

Lemma sublist_incl : forall A (l m : list A), Sublist l m -> incl l m.
Proof. intros A l m S; induction S; intros y I; [destruct I | destruct I as [<- | I]; simpl; auto | simpl; auto]. Qed.

Lemma sublist_nodup : forall A (l m : list A), Sublist l m -> NoDup m -> NoDup l.
Proof.
  intros A l m S; induction S; intros N; auto; inversion N; subst; auto.
  constructor; auto. intros I. apply (sublist_incl _ _ _ S) in I; auto.
Qed.

Lemma sublist_filter : forall A (f : A -> bool) l, Sublist (filter f l) l.
Proof. induction l as [| a l IH]; simpl; [constructor |]. destruct (f a); now constructor. Qed.

Lemma sublist_length : forall A (l m : list A), Sublist l m -> length l <= length m /\ (length m <= length l -> l = m).
Proof.
  intros A l m S; induction S as [| x l m S [L Q] | x l m S [L Q]]; simpl; auto.
  - split; [lia |]. intros H. rewrite Q; auto; lia.
  - split; [lia |]. intros H; lia.
Qed.

Variable requires : occurrence -> nat.

(** Unordered occurrences, and the scenarios of a vote: at least [k] of them. *)
Definition unordered (l : list occurrence) : shape := Shape l (fun _ _ => false) requires.
Definition vote (k : nat) (l : list occurrence) : list shape :=
  map unordered (filter (fun m => Nat.leb k (length m)) (sublists l)).

Lemma in_vote : forall k l x, In x (vote k l) <-> exists m, x = unordered m /\ Sublist m l /\ k <= length m.
Proof.
  intros k l x. unfold vote. rewrite in_map_iff. split; intros (m & H & I); exists m.
  - apply filter_In in I as [I L]. apply in_sublists in I. apply Nat.leb_le in L. auto.
  - destruct I as [I L]. split; auto. apply filter_In; split; [now apply in_sublists | now apply Nat.leb_le].
Qed.

(** [and] is the vote for all. *)
Lemma vote_all : forall l x, In x (vote (length l) l) <-> x = unordered l.
Proof.
  intros l x. rewrite in_vote. split.
  - intros (m & -> & S & L). apply sublist_length in S as [_ S]. now rewrite S.
  - intros ->. exists l; repeat split; auto. clear. induction l; constructor; auto.
Qed.

Lemma ready_unordered : forall l done o, ready (unordered l) done o = negb (among o done).
Proof.
  intros; unfold ready; simpl. replace (forallb _ l) with true; [apply andb_true_r |].
  symmetry; now apply forallb_forall.
Qed.

(** No event serves two of the leaves. *)
Definition disjoint (l : list occurrence) : Prop := forall o p e, In o l -> In p l ->
  satisfies (requires o) e = true -> satisfies (requires p) e = true -> o = p.

(** *** [scattered]: a conjunction, a threshold *)

Definition occurs (o : occurrence) : formula := Eventually (Atom (requires o)).
Definition and_text (l : list occurrence) : formula := conjunction (map occurs l).

Lemma holds_occurs : forall o u, holds (occurs o) u = existsb (satisfies (requires o)) u.
Proof.
  intros o; induction u as [| e u IH]; auto. change (satisfies (requires o) e || holds (occurs o) u
    = satisfies (requires o) e || existsb (satisfies (requires o)) u). now rewrite IH.
Qed.

Lemma unordered_completes : forall l done u, disjoint l -> (Completes Scattered (unordered l) done u <->
  forall o, In o l -> among o done = false -> existsb (satisfies (requires o)) u = true).
Proof.
  intros l done u D; split.
  - intros K; induction K as [d u F | d e u S K IH | d e u o C I R S K IH]; intros p J A.
    + unfold finished in F. rewrite forallb_forall in F. apply F in J. congruence.
    + simpl. rewrite IH; auto. apply orb_true_r.
    + simpl. destruct (same p o) eqn:Q; [apply same_iff in Q as ->; simpl in S; now rewrite S |].
      rewrite IH; auto using orb_true_r. simpl. now rewrite Q.
  - revert done; induction u as [| e u IH]; intros done H.
    + apply completed. apply forallb_forall. intros o I. destruct (among o done) eqn:A; auto.
      specialize (H o I A). discriminate.
    + destruct (find (fun o => negb (among o done) && satisfies (requires o) e) l) as [o |] eqn:F.
      * apply find_some in F as [I F]. apply andb_true_iff in F as [A S]. apply served with o; auto.
        -- now rewrite ready_unordered.
        -- apply IH. intros p J A'. simpl in A'. apply orb_false_iff in A' as [N A'].
           specialize (H p J A'). simpl in H. apply orb_true_iff in H as [H | H]; auto.
           rewrite (D p o e J I H S), same_refl in N. discriminate.
      * apply skipped; auto. apply IH. intros p J A. specialize (H p J A). simpl in H.
        apply orb_true_iff in H as [H | H]; auto. apply (find_none _ _ F) in J. rewrite A, H in J. discriminate.
Qed.

Lemma unordered_detected : forall l u, disjoint l -> (Completes Scattered (unordered l) [] u <->
  forallb (fun o => existsb (satisfies (requires o)) u) l = true).
Proof.
  intros l u D. rewrite unordered_completes, forallb_forall by exact D. split; intros H o I; auto.
Qed.

(** At least [k] of the formulas: T(k, f l) = f & T(k-1, l) | T(k, l). *)
Fixpoint threshold (k : nat) (l : list formula) : formula :=
  match k, l with
  | O, _ => Truth
  | S _, [] => Falsity
  | S k', f :: l => disjoin (conjoin f (threshold k' l)) (threshold k l)
  end.

Lemma holds_threshold : forall l k u, holds (threshold k l) u = (k <=? length (filter (fun f => holds f u) l)).
Proof.
  induction l as [| f l IH]; intros [| k] u; auto. cbn [threshold filter].
  rewrite holds_disjoin, holds_conjoin, !IH. destruct (holds f u); cbn [length andb]; auto.
  change (S k <=? S ?n) with (k <=? n). apply eq_true_iff_eq. rewrite orb_true_iff, !Nat.leb_le. lia.
Qed.

Definition vote_text (k : nat) (l : list occurrence) : formula := threshold k (map occurs l).

Lemma filter_map_length : forall A B (f : A -> B) p l,
  length (filter p (map f l)) = length (filter (fun a => p (f a)) l).
Proof. induction l as [| a l IH]; simpl; auto. destruct (p (f a)); simpl; auto. Qed.

Lemma sublist_forall_length : forall A (p : A -> bool) l m, Sublist m l -> forallb p m = true ->
  length m <= length (filter p l).
Proof.
  intros A p l m S; induction S; simpl; intros H; auto.
  - apply andb_true_iff in H as [P H]. rewrite P. simpl. apply IHS in H. lia.
  - apply IHS in H. destruct (p x); simpl; lia.
Qed.

Lemma disjoint_sublist : forall l m, Sublist m l -> disjoint l -> disjoint m.
Proof. intros l m S D o p e I J. apply D; now apply (sublist_incl _ _ _ S). Qed.

(** The threshold text of a vote over disjoint leaves, under [scattered]. *)
Theorem vote_text_correct : forall k l, disjoint l -> forall u,
  holds (vote_text k l) u = true <-> Detected Scattered (vote k l) u.
Proof.
  intros k l D u. rewrite detected_base by auto. unfold vote_text.
  rewrite holds_threshold, filter_map_length, Nat.leb_le.
  rewrite (filter_ext _ _ (fun o => holds_occurs o u)). split.
  - intros L. eexists; split; [apply in_vote; eexists; repeat split; [apply sublist_filter | exact L] |].
    apply unordered_detected; [eapply disjoint_sublist; eauto; apply sublist_filter |].
    apply forallb_forall. intros o I. now apply filter_In in I.
  - intros (x & I & K). apply in_vote in I as (m & -> & S & L).
    apply unordered_detected in K; [| eapply disjoint_sublist; eauto].
    apply (sublist_forall_length _ _ _ _ S) in K. lia.
Qed.

(** [F a & F b & F c] for an [and] over disjoint leaves, under [scattered]. *)
Theorem and_text_correct : forall l, disjoint l -> forall u,
  holds (and_text l) u = true <-> Detected Scattered [unordered l] u.
Proof.
  intros l D u. rewrite detected_base by auto. unfold and_text. rewrite holds_conjunction, forallb_map.
  rewrite (forallb_ext_in _ _ (fun o => existsb (satisfies (requires o)) u)) by (intros; apply holds_occurs).
  rewrite <- unordered_detected by exact D. split.
  - intros K; eexists; split; [left; reflexivity | exact K].
  - intros (x & [<- | []] & K); exact K.
Qed.

(** *** [strict]: a window of [k] positions, each served by some leaf, none served twice *)

Definition some_leaf (l : list occurrence) : formula := disjunction (map (fun o => Atom (requires o)) l).

Fixpoint each_position (k : nat) (f : formula) : formula :=
  match k with O => Truth | S O => f | S k => Conj f (Next (each_position k f)) end.

(** The atom within the first [k] positions, and at two of them. *)
Fixpoint once (k : nat) (p : nat) : formula :=
  match k with O => Falsity | S O => Atom p | S k => Disj (Atom p) (Next (once k p)) end.
Fixpoint twice (k : nat) (p : nat) : formula :=
  match k with
  | O | S O => Falsity
  | S (S O) => Conj (Atom p) (Next (Atom p))
  | S k => Disj (Conj (Atom p) (Next (once k p))) (Next (twice k p))
  end.

Definition window (k : nat) (l : list occurrence) : formula :=
  conjoin (each_position k (some_leaf l)) (conjunction (map (fun o => Neg (twice k (requires o))) l)).

Definition count (p : nat) (u : list E) : nat := length (filter (satisfies p) u).

Lemma holds_next_cons : forall f e u, holds f [] = false -> holds (Next f) (e :: u) = holds f u.
Proof. intros f e [| a u] Z; simpl; auto. Qed.

Lemma holds_each_position : forall f, holds f [] = false -> forall k u,
  holds (each_position (S k) f) u = true <->
  S k <= length u /\ forall v e w, firstn (S k) u = v ++ e :: w -> holds f (e :: skipn (S (length v)) u) = true.
Proof.
  intros f Z; induction k as [| k IH]; intros u.
  - cbn [each_position]. split.
    + intros H. destruct u as [| e u]; [congruence |]. split; [simpl; lia |]. intros v e' w Q. simpl in Q.
      destruct v as [| a [| b v]]; simpl in Q; injection Q as <- Q; try discriminate. exact H.
    + intros [L A]. destruct u as [| e u]; [simpl in L; lia |]. apply (A [] e []). reflexivity.
  - assert (Z' : holds (each_position (S k) f) [] = false).
    { apply not_true_is_false. rewrite IH. simpl. intros [L _]; lia. }
    change (holds (each_position (S (S k)) f) u) with (holds f u && holds (Next (each_position (S k) f)) u).
    destruct u as [| e u]; [rewrite Z; simpl; split; [discriminate | lia] |].
    rewrite holds_next_cons, andb_true_iff, IH by exact Z'. split.
    + intros (H & L & A). split; [simpl; lia |]. intros [| a v] e' w Q; simpl firstn in Q.
      * injection Q as -> _. exact H.
      * injection Q as <- Q. apply (A v e' w Q).
    + intros (L & A). simpl in L. repeat split; [| lia |].
      * apply (A [] e (firstn (S k) u)). reflexivity.
      * intros v e' w Q. apply (A (e :: v) e' w). simpl firstn in *. now rewrite Q.
Qed.

Lemma holds_once : forall p k u, holds (once k p) u = (1 <=? count p (firstn k u)).
Proof.
  intros p; induction k as [| k IH]; intros u; [reflexivity |].
  assert (Z : holds (once k p) [] = false) by (rewrite IH; destruct k; reflexivity).
  destruct u as [| e u].
  - destruct k as [| k]; auto.
  - assert (Q : holds (once (S k) p) (e :: u) = satisfies p e || holds (once k p) u).
    { destruct k as [| k]; [simpl; now rewrite orb_false_r |].
      change (holds (once (S (S k)) p) (e :: u)) with (satisfies p e || holds (Next (once (S k) p)) (e :: u)).
      now rewrite holds_next_cons. }
    rewrite Q, IH. unfold count. simpl firstn. simpl filter. destruct (satisfies p e); reflexivity.
Qed.

Lemma holds_twice : forall p k u, holds (twice k p) u = (2 <=? count p (firstn k u)).
Proof.
  intros p; induction k as [| k IH]; intros u; [reflexivity |].
  assert (Z : holds (twice k p) [] = false) by (rewrite IH; destruct k; reflexivity).
  assert (Z1 : holds (once k p) [] = false) by (rewrite holds_once; destruct k; reflexivity).
  destruct u as [| e u].
  - destruct k as [| [| k]]; auto.
  - assert (Q : holds (twice (S k) p) (e :: u) = (satisfies p e && holds (once k p) u) || holds (twice k p) u).
    { destruct k as [| [| k]].
      - simpl. now rewrite andb_false_r.
      - simpl twice. simpl once. change (holds (Conj (Atom p) (Next (Atom p))) (e :: u))
          with (satisfies p e && holds (Next (Atom p)) (e :: u)).
        rewrite holds_next_cons by reflexivity. simpl. now rewrite orb_false_r.
      - change (holds (twice (S (S (S k))) p) (e :: u)) with
          ((satisfies p e && holds (Next (once (S (S k)) p)) (e :: u)) || holds (Next (twice (S (S k)) p)) (e :: u)).
        now rewrite !holds_next_cons. }
    rewrite Q, IH, holds_once. unfold count. simpl firstn. simpl filter. destruct (satisfies p e); simpl length; auto.
    destruct (length (filter (satisfies p) (firstn k u))) as [| [| n]]; reflexivity.
Qed.

(** The first [k] events: each serves some leaf, and no leaf is served twice. *)
Definition serves (l : list occurrence) (v : list E) : Prop :=
  (forall e, In e v -> exists o, In o l /\ satisfies (requires o) e = true) /\
  (forall o, In o l -> count (requires o) v <= 1).

Lemma holds_some_leaf : forall l e u, holds (some_leaf l) (e :: u) = existsb (fun o => satisfies (requires o) e) l.
Proof. intros. unfold some_leaf. now rewrite holds_disjunction, existsb_map. Qed.

Lemma window_serves : forall k l u, 0 < k -> (holds (window k l) u = true <-> k <= length u /\ serves l (firstn k u)).
Proof.
  intros [| k] l u L; [lia |]. unfold window. rewrite holds_conjoin, andb_true_iff, holds_conjunction, forallb_map.
  assert (Z : holds (some_leaf l) [] = false).
  { unfold some_leaf. rewrite holds_disjunction, existsb_map. clear. induction l; auto. }
  rewrite holds_each_position by exact Z. rewrite forallb_forall. unfold serves.
  assert (A : (forall v e w, firstn (S k) u = v ++ e :: w ->
    holds (some_leaf l) (e :: skipn (S (length v)) u) = true) <->
              (forall e, In e (firstn (S k) u) -> exists o, In o l /\ satisfies (requires o) e = true)).
  { split.
    - intros H e I. apply in_split in I as (v & w & Q). specialize (H v e w Q). rewrite holds_some_leaf in H.
      now apply existsb_exists.
    - intros H v e w Q. rewrite holds_some_leaf. apply existsb_exists, H. rewrite Q. apply in_app_iff; simpl; auto. }
  rewrite A.
  assert (T : forall o, holds (Neg (twice (S k) (requires o))) u = true <-> count (requires o) (firstn (S k) u) <= 1).
  { intros o. change (holds (Neg (twice (S k) (requires o))) u) with (negb (holds (twice (S k) (requires o)) u)).
    rewrite holds_twice, negb_true_iff, Nat.leb_gt. lia. }
  split.
  - intros [[B H] N]. repeat split; auto. intros o I. now apply T, N.
  - intros [B [H N]]. repeat split; auto. intros o I. now apply T, N.
Qed.

Definition undone (l done : list occurrence) : nat := length (filter (fun o => negb (among o done)) l).

Lemma undone_served : forall l done o, NoDup l -> In o l -> among o done = false ->
  undone l done = S (undone l (o :: done)).
Proof.
  intros l done o N I A. unfold undone. induction l as [| p l IH]; [destruct I |]. inversion N as [| ? ? NI N']; subst.
  simpl.
  destruct I as [-> | I].
  - rewrite A, same_refl. simpl. f_equal. f_equal. apply filter_ext_in. intros q J. simpl.
    rewrite same_false; auto. intros ->; contradiction.
  - rewrite (same_false p o) by (intros ->; contradiction). simpl. destruct (among p done); simpl; rewrite IH; auto.
Qed.

(** A match of unordered leaves uses the first events, as many as there are leaves left. *)
Lemma strict_uses : forall l done u, disjoint l -> NoDup l -> forall m, Sublist m l ->
  Completes Strict (unordered m) done u ->
  undone m done <= length u /\
  (forall e, In e (firstn (undone m done) u) -> exists o, In o m /\ among o done = false /\
    satisfies (requires o) e = true) /\
  (forall o, In o l -> count (requires o) (firstn (undone m done) u) <= 1).
Proof.
  intros l done u D ND m SU K. assert (NM := sublist_nodup _ _ _ SU ND). assert (IN := sublist_incl _ _ _ SU).
  induction K as [d u F | d e u S K IH | d e u o C I R S K IH].
  - assert (Q : undone m d = 0).
    { unfold undone. unfold finished in F. simpl in F. clear - F. induction m as [| o m IH]; simpl in *; auto.
      apply andb_true_iff in F as [-> F]. simpl. auto. }
    rewrite Q. simpl. repeat split; try lia; auto.
  - discriminate.
  - simpl in I, S. rewrite ready_unordered, negb_true_iff in R. destruct IH as (L & A & N).
    rewrite (undone_served m d o) by auto. simpl. repeat split; [lia | |].
    + intros e' [<- | J]; [exists o; auto |]. destruct (A e' J) as (p & P & Q & T). exists p; repeat split; auto.
      simpl in Q. now apply orb_false_iff in Q.
    + intros p P. unfold count. simpl. destruct (satisfies (requires p) e) eqn:SP; [| now apply N].
      assert (p = o) by (apply (D p o e); auto). subst p. simpl.
      assert (Z : filter (satisfies (requires o)) (firstn (undone m (o :: d)) u) = []).
      { destruct (filter _ _) as [| a f] eqn:Q; auto. exfalso.
        assert (J : In a (filter (satisfies (requires o)) (firstn (undone m (o :: d)) u))) by (rewrite Q; simpl; auto).
        apply filter_In in J as [J T]. destruct (A a J) as (q & Q1 & Q2 & Q3).
        rewrite (D q o a) in Q2; auto. simpl in Q2. now rewrite same_refl in Q2. }
      rewrite Z; auto.
Qed.

(** Events that serve the leaves left, each once, complete the match. *)
Lemma strict_completes : forall m v done, disjoint m ->
  (forall e, In e v -> exists o, In o m /\ among o done = false /\ satisfies (requires o) e = true) ->
  (forall o, In o m -> count (requires o) v <= 1) ->
  (forall o, In o m -> among o done = false -> existsb (satisfies (requires o)) v = true) ->
  Completes Strict (unordered m) done v.
Proof.
  intros m v; induction v as [| e v IH]; intros done D A C X.
  - apply completed. apply forallb_forall. intros o I. destruct (among o done) eqn:Q; auto.
    specialize (X o I Q). discriminate.
  - destruct (A e) as (o & I & Q & S); [simpl; auto |]. apply served with o; auto.
    + rewrite ready_unordered, Q; auto.
    + apply IH; auto.
      * intros e' J. destruct (A e') as (p & P & R & T); [simpl; auto |]. exists p; repeat split; auto. simpl.
        rewrite R, same_false; auto. intros ->. specialize (C o I). unfold count in C. simpl in C. rewrite S in C.
        assert (K : In e' (filter (satisfies (requires o)) v)) by (apply filter_In; auto).
        simpl in C. destruct (filter _ v); [destruct K | simpl in C; lia].
      * intros p P. specialize (C p P). unfold count in *. simpl in C.
        destruct (satisfies (requires p) e); simpl in C; lia.
      * intros p P R. simpl in R. apply orb_false_iff in R as [N R]. specialize (X p P R). simpl in X.
        apply orb_true_iff in X as [X | X]; auto. rewrite (D p o e), same_refl in N; auto. discriminate.
Qed.

Lemma serving_leaves : forall l v, serves l v ->
  length v <= length (filter (fun o => existsb (satisfies (requires o)) v) l).
Proof.
  intros l; induction v as [| e v IH]; intros [A C]; [simpl; lia |].
  assert (SV : serves l v).
  { split; [intros e' I; apply A; simpl; auto |]. intros o I. specialize (C o I). unfold count in *. simpl in C.
    destruct (satisfies (requires o) e); simpl in C; lia. }
  specialize (IH SV). destruct (A e) as (o & I & S); [simpl; auto |].
  refine (Nat.le_lt_trans _ _ _ IH _).
  apply filter_less with o; auto.
  - intros p H. simpl. rewrite H. apply orb_true_r.
  - specialize (C o I). unfold count in C. simpl in C. rewrite S in C. simpl in C.
    apply not_true_is_false. intros H. apply existsb_exists in H as (e' & J & T).
    assert (K : In e' (filter (satisfies (requires o)) v)) by (apply filter_In; auto).
    destruct (filter _ v); [destruct K | simpl in C; lia].
  - simpl. now rewrite S.
Qed.

Lemma strict_vote : forall k l u, disjoint l -> NoDup l ->
  (k <= length u /\ serves l (firstn k u) <-> exists x, In x (vote k l) /\ Completes Strict x [] u).
Proof.
  intros k l u D ND. split.
  - intros [L SV]. set (m := filter (fun o => existsb (satisfies (requires o)) (firstn k u)) l).
    assert (SU : Sublist m l) by apply sublist_filter. exists (unordered m). split.
    + apply in_vote. exists m; repeat split; auto. apply serving_leaves in SV. rewrite firstn_length_le in SV; auto.
    + rewrite <- (firstn_skipn k u) at 1. apply completes_app. destruct SV as [A C]. apply strict_completes.
      * eapply disjoint_sublist; eauto.
      * intros e I. destruct (A e I) as (o & O & S). exists o; repeat split; auto. apply filter_In; split; auto.
        apply existsb_exists; eauto.
      * intros o I. apply C. now apply (sublist_incl _ _ _ SU).
      * intros o I _. now apply filter_In in I.
  - intros (x & I & K). apply in_vote in I as (m & -> & SU & LM).
    destruct (strict_uses l [] u D ND m SU K) as (L & A & C).
    assert (Q : undone m [] = length m) by (unfold undone; clear; induction m; simpl; auto).
    rewrite Q in *. split; [lia |].
    assert (P : firstn k u = firstn k (firstn (length m) u)) by (rewrite firstn_firstn; f_equal; lia).
    assert (SP : exists w, firstn (length m) u = firstn k u ++ w).
    { rewrite P. exists (skipn k (firstn (length m) u)). now rewrite firstn_skipn. }
    destruct SP as [w W]. split.
    + intros e I. destruct (A e) as (o & O & _ & S); [rewrite W; apply in_app_iff; auto |].
      exists o; split; auto. now apply (sublist_incl _ _ _ SU).
    + intros o I. specialize (C o I). rewrite W in C. unfold count in *. rewrite filter_app, app_length in C. lia.
Qed.

Lemma bounded_conjoin : forall f g, bounded f = true -> bounded g = true -> bounded (conjoin f g) = true.
Proof. intros f g A B; destruct f, g; simpl in *; rewrite ?A, ?B; auto. Qed.

Lemma bounded_each : forall f k, bounded f = true -> bounded (each_position k f) = true.
Proof. intros f k B; induction k as [| [| k] IH]; auto. simpl in *. now rewrite B. Qed.

Lemma bounded_once : forall k p, bounded (once k p) = true.
Proof. intros k p; induction k as [| [| k] IH]; auto. Qed.

Lemma bounded_twice : forall k p, bounded (twice k p) = true.
Proof.
  intros k p; induction k as [| [| [| k]] IH]; auto.
  change (bounded (twice (S (S (S k))) p)) with (bounded (once (S (S k)) p) && bounded (twice (S (S k)) p)).
  now rewrite bounded_once, IH.
Qed.

Lemma bounded_window : forall k l, bounded (window k l) = true.
Proof.
  intros k l. apply bounded_conjoin.
  - apply bounded_each, bounded_disjunction. rewrite forallb_map. now apply forallb_forall.
  - unfold conjunction. induction l as [| o l IH]; auto. cbn [map fold_right]. apply bounded_conjoin; auto.
    apply bounded_twice.
Qed.

(** The window text of a vote over disjoint leaves that nothing follows. *)
Definition window_text (s : semantics) (k : nat) (l : list occurrence) : formula := text_of s (window k l).

Theorem window_text_correct : forall s k l, s <> Scattered -> 0 < k -> disjoint l -> NoDup l -> forall u,
  holds (window_text s k l) u = true <-> Detected s (vote k l) u.
Proof.
  intros s k l NS K D N. apply text_of_correct; auto.
  - apply bounded_window.
  - apply not_true_is_false. rewrite window_serves by exact K. simpl. intros [L _]; lia.
  - intros u. rewrite window_serves, detected_base by auto. now apply strict_vote.
Qed.

(** [and] over disjoint leaves under [strict], [projected] and [consecutive]: the window of all of them. *)
Theorem and_window_correct : forall s l, s <> Scattered -> l <> [] -> disjoint l -> NoDup l -> forall u,
  holds (window_text s (length l) l) u = true <-> Detected s [unordered l] u.
Proof.
  intros s l NS NE D N u. rewrite window_text_correct by (destruct l; simpl; try congruence; auto; lia).
  rewrite !detected_completes. split; intros (x & v & w & I & R); exists x, v, w; split; auto.
  - apply vote_all in I as ->; simpl; auto.
  - destruct I as [<- | []]. now apply vote_all.
Qed.
End Gates.
