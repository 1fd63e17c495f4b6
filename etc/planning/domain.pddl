; What the arm can do with things on a table.
;
; Relations come from the working memory (planner/pddl.py): `on` and `ontable` from edges `on`, `holding` from edges
; `grasping`. `clear` and `handempty` follow from them at every moment, so they are derived here too and cannot
; contradict them; a thing that rests on two others is lifted off both.

(define (domain tabletop)
  (:requirements :typing :negative-preconditions :universal-preconditions :conditional-effects :derived-predicates)
  (:types thing)

  (:predicates
    (on ?x - thing ?y - thing)    ; ?x rests on ?y
    (ontable ?x - thing)          ; ?x rests on a table
    (holding ?x - thing)          ; the gripper holds ?x
    (taken ?x - thing)            ; somebody else holds ?x
    (graspable ?x - thing)        ; fits between the fingers
    (flat ?x - thing)             ; carries what is put on it
    (clear ?x - thing)            ; nothing rests on ?x, nobody holds it
    (handempty))                  ; the gripper holds nothing

  (:derived (clear ?x - thing)
    (and (not (holding ?x)) (not (taken ?x)) (forall (?y - thing) (not (on ?y ?x)))))

  (:derived (handempty)
    (forall (?x - thing) (not (holding ?x))))

  (:action pick                   ; from wherever it is
    :parameters (?x - thing)
    :precondition (and (handempty) (clear ?x) (graspable ?x))
    :effect (and (holding ?x) (not (ontable ?x)) (forall (?y - thing) (not (on ?x ?y)))))

  (:action stack                  ; on another thing
    :parameters (?x - thing ?y - thing)
    :precondition (and (holding ?x) (clear ?y) (flat ?y))
    :effect (and (not (holding ?x)) (on ?x ?y)))

  (:action putdown                ; on the table, at a free place
    :parameters (?x - thing)
    :precondition (holding ?x)
    :effect (and (not (holding ?x)) (ontable ?x))))
