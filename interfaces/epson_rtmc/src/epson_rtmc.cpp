// Copyright 2026 the epson_driver developers
// SPDX-License-Identifier: Apache-2.0
// Real-time Motion Control behind C functions: a Fast DDS participant, and the client's exchange with a controller.
//
// The exchange sends one request at a time. In a motion it answers each reply with the next target of a ring, in the
// thread that receives. Python fills the ring and knows the limits. Each filling ends with targets that brake to rest,
// so that the arm comes to rest within the limits if Python fills no more.
#include <algorithm>
#include <array>
#include <atomic>
#include <chrono>
#include <cstring>
#include <deque>
#include <fastdds/dds/domain/DomainParticipant.hpp>
#include <fastdds/dds/domain/DomainParticipantFactory.hpp>
#include <fastdds/dds/publisher/DataWriter.hpp>
#include <fastdds/dds/publisher/DataWriterListener.hpp>
#include <fastdds/dds/publisher/Publisher.hpp>
#include <fastdds/dds/subscriber/DataReader.hpp>
#include <fastdds/dds/subscriber/DataReaderListener.hpp>
#include <fastdds/dds/subscriber/SampleInfo.hpp>
#include <fastdds/dds/subscriber/Subscriber.hpp>
#include <fastdds/dds/topic/TypeSupport.hpp>
#include <fastdds/rtps/transport/UDPv4TransportDescriptor.h>
#include <fastrtps/utils/IPLocator.h>
#include <memory>
#include <mutex>
#include <sys/eventfd.h>
#include <thread>
#include <unistd.h>
#include <vector>

using namespace eprosima::fastdds::dds;
using Bytes = std::vector<uint8_t>;
using Payload = eprosima::fastrtps::rtps::SerializedPayload_t;

struct BytesType : TopicDataType {
  BytesType() { setName("RRDSturuct"); m_typeSize = 120; }  // the name and the size of EPSON's type
  bool serialize(void* data, Payload* payload) override {
    const auto& bytes = *static_cast<Bytes*>(data);
    if (bytes.size() > payload->max_size) return false;
    payload->encapsulation = CDR_LE;
    payload->length = static_cast<uint32_t>(bytes.size());
    std::memcpy(payload->data, bytes.data(), bytes.size());
    return true;
  }
  bool deserialize(Payload* payload, void* data) override {
    static_cast<Bytes*>(data)->assign(payload->data, payload->data + payload->length);
    return true;
  }
  std::function<uint32_t()> getSerializedSizeProvider(void* data) override {
    return [data] { return static_cast<uint32_t>(static_cast<Bytes*>(data)->size()); };
  }
  void* createData() override { return new Bytes; }
  void deleteData(void* data) override { delete static_cast<Bytes*>(data); }
  bool getKey(void*, InstanceHandle_t*, bool) override { return false; }
};

static uint64_t number(const InstanceHandle_t& handle) {  // the participant's part of a writer's GUID
  uint64_t result;
  std::memcpy(&result, reinterpret_cast<const uint8_t*>(&handle) + 4, sizeof result);
  return result;
}

using Target = std::array<double, 6>;

struct Arrival {
  double time;  // of the arrival, s, by CLOCK_MONOTONIC
  uint64_t sender;
  int size;  // of the data, LOST or FAILED
  Bytes data;
};

static constexpr uint16_t JOINTS_NOTICE = 1, MOVE = 1014;  // message IDs; smaller ones than the first are notices, too
static constexpr int LOST = -1, FAILED = -2;
static constexpr size_t MAX_ARRIVALS = 16384;
static constexpr size_t MAX_MOVED = 1024;  // arrivals with which replies to targets are kept: Python is late then
static constexpr int BATCH = 5;        // replies to targets for which Python is woken once
static constexpr size_t HEADER = 16;  // encapsulation, ID, padding, two words, length of the data
static constexpr uint32_t TARGET_SIZE = 6 * 8 + 2;

static uint16_t word(const Bytes& bytes, size_t offset) {
  return static_cast<uint16_t>(bytes[offset] | bytes[offset + 1] << 8);
}

static double now() {
  return std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch()).count();
}

using Writer = int (*)(const uint8_t*, uint32_t);

struct Peer : DataReaderListener, DataWriterListener {
  DomainParticipant* participant = nullptr;
  DataWriter* writer = nullptr;
  DataReader* reader = nullptr;
  Writer other_writer = nullptr;  // instead of DDS, for virtual time
  std::thread thread;
  std::atomic<bool> closing{false};
  std::atomic<int> matched_readers{0}, matched_writers{0};

  std::mutex arrivals_mutex;  // Fast DDS is not called with it, since its listeners need it
  std::deque<Arrival> arrivals;
  int event = -1;
  bool signalled = false;
  bool quiet = false;  // whether Python polls the arrivals
  int unsignalled = 0;
  std::atomic<bool> broken{false};      // whether no more targets are sent
  std::atomic<bool> late{false};        // whether replies to targets were discarded: the motion is to brake
  std::atomic<uint64_t> controller{0};  // sender of the first reply
  std::atomic<bool> tracing{false};     // whether own messages are reported, too

  std::mutex mutex;           // of the exchange
  std::deque<Bytes> waiting;  // requests
  double received = 0.0;      // time of the last reply
  uint16_t pending = 0;       // ID of the request that has no reply yet
  bool moving = false;        // whether targets are sent
  std::deque<Target> targets;
  Target last{};                // the target that was sent last
  uint64_t taken = 0;           // number of targets that were sent
  uint64_t replaceable_to = 0;  // number of targets before those that brake

  void on_publication_matched(DataWriter*, const PublicationMatchedStatus& status) override {
    matched_readers = status.current_count;
  }

  void on_subscription_matched(DataReader*, const SubscriptionMatchedStatus& status) override {
    matched_writers = status.current_count;
    if (status.current_count_change < 0) report({now(), number(status.last_publication_handle), LOST, {}});
  }

  void report(Arrival arrival, bool urgent = true, size_t most = MAX_ARRIVALS) {
    std::lock_guard<std::mutex> lock(arrivals_mutex);
    const bool other = arrival.size == LOST && controller && arrival.sender != controller;
    if (arrival.size < 0 && !other) broken = true;
    if (arrival.size >= 0 && arrivals.size() >= most) {
      late = true;
      return;
    }
    arrivals.push_back(std::move(arrival));
    if (urgent || ++unsignalled >= BATCH) wake();
  }

  void wake() {  // with the mutex of the arrivals
    if (signalled || quiet || event < 0) return;
    signalled = true;
    unsignalled = 0;
    eventfd_write(event, 1);
  }

  bool matched() const { return matched_readers && matched_writers; }

  int write(Bytes bytes) {
    if (other_writer) return other_writer(bytes.data(), static_cast<uint32_t>(bytes.size()));
    if (!matched()) return 0;
    return writer->write(&bytes) ? 1 : -1;
  }

  int send_next() {  // with the mutex
    if (pending) return 1;
    Bytes bytes;
    if (!waiting.empty()) {
      bytes = std::move(waiting.front());
      waiting.pop_front();
    } else if (moving && !broken) {
      if (!targets.empty()) {
        last = targets.front();
        targets.pop_front();
        ++taken;
      }
      bytes.resize(HEADER + TARGET_SIZE);
      const uint16_t id = MOVE;
      bytes[1] = 1;  // little endian
      std::memcpy(&bytes[4], &id, sizeof id);
      std::memcpy(&bytes[12], &TARGET_SIZE, sizeof TARGET_SIZE);
      std::memcpy(&bytes[HEADER], last.data(), sizeof last);
    } else {
      return 1;
    }
    pending = word(bytes, 4);
    Bytes traced = tracing ? bytes : Bytes();
    const double time = other_writer ? received : now();  // virtual, or real
    const int sent = write(std::move(bytes));
    if (sent > 0 && !traced.empty()) report({time, 0, static_cast<int>(traced.size()), std::move(traced)}, false, MAX_MOVED);
    if (sent <= 0) pending = 0, moving = false;
    return sent;
  }

  void receive(Arrival arrival) {
    const Bytes& data = arrival.data;
    const uint16_t id = data.size() < HEADER ? 0 : word(data, 4);
    if (id <= JOINTS_NOTICE) return report(std::move(arrival));
    std::lock_guard<std::mutex> lock(mutex);
    if (!controller) controller = arrival.sender;
    received = arrival.time;
    const bool answered = id == pending && arrival.sender == controller;
    if (answered) pending = 0;
    if (answered && id == MOVE && !word(data, 10)) moving = false;  // refused
    const bool moved = answered && id == MOVE && moving;
    const bool first = answered && !tracing;  // in a trace, the reply precedes the next target
    int sent = first ? send_next() : 1;
    report(std::move(arrival), !moved, moved ? MAX_MOVED : MAX_ARRIVALS);
    if (answered && !first) sent = send_next();
    if (sent < 0) report({now(), 0, FAILED, {}});
  }

  void run() {
    try {
      while (!closing) {
        const bool unread = reader->wait_for_unread_message({0, 20000000});
        if (unread && !matched()) {  // the first request may arrive before it can be answered
          std::this_thread::sleep_for(std::chrono::milliseconds(1));
          continue;
        }
        Bytes bytes;
        SampleInfo info;
        while (reader->take_next_sample(&bytes, &info) == ReturnCode_t::RETCODE_OK) {
          if (!info.valid_data) continue;
          const int size = static_cast<int>(bytes.size());
          receive({now(), number(info.publication_handle), size, std::move(bytes)});
          bytes = {};
        }
      }
    } catch (...) {
      report({now(), 0, FAILED, {}});
    }
  }
};

static eprosima::fastrtps::rtps::Locator_t locator(const char* address, uint32_t port) {
  eprosima::fastrtps::rtps::Locator_t result;
  eprosima::fastrtps::rtps::IPLocator::setIPv4(result, address);
  result.port = port;
  return result;
}

extern "C" {

void epson_rtmc_close(void* handle) {
  auto* peer = static_cast<Peer*>(handle);
  peer->closing = true;
  if (peer->thread.joinable()) peer->thread.join();
  if (peer->participant) {
    peer->participant->delete_contained_entities();
    DomainParticipantFactory::get_instance()->delete_participant(peer->participant);
  }
  if (peer->event >= 0) close(peer->event);
  delete peer;
}

// Ports of 0 are free ones. peer_address may be null. Returns null if the participant cannot be created.
void* epson_rtmc_open(const char* address, uint32_t port, uint32_t data_port, const char* peer_address,
                      uint32_t peer_port, const char* writes, const char* reads) try {
  auto udp = std::make_shared<eprosima::fastdds::rtps::UDPv4TransportDescriptor>();
  udp->interfaceWhiteList.emplace_back(address);  // no other network hears of it
  DomainParticipantQos qos = PARTICIPANT_QOS_DEFAULT;
  qos.transport().use_builtin_transports = false;
  qos.transport().user_transports.push_back(udp);
  auto& wire = qos.wire_protocol();
  wire.builtin.metatrafficUnicastLocatorList.push_back(locator(address, port));  // and so no multicast
  wire.default_unicast_locator_list.push_back(locator(address, data_port));
  if (peer_address) wire.builtin.initialPeersList.push_back(locator(peer_address, peer_port));
  wire.builtin.discovery_config.leaseDuration = {1, 0};
  wire.builtin.discovery_config.leaseDuration_announcementperiod = {0, 500000000};

  std::unique_ptr<Peer, void (*)(void*)> peer(new Peer, epson_rtmc_close);
  peer->event = eventfd(0, EFD_CLOEXEC | EFD_NONBLOCK);
  if (peer->event < 0) return nullptr;
  peer->participant = DomainParticipantFactory::get_instance()->create_participant(0, qos);
  if (peer->participant) {
    TypeSupport type(new BytesType);
    type.register_type(peer->participant);
    Topic* topic = peer->participant->create_topic("DDSCommunicationTopic", type.get_type_name(), TOPIC_QOS_DEFAULT);
    PublisherQos publisher_qos = PUBLISHER_QOS_DEFAULT;
    publisher_qos.partition().push_back(writes);
    SubscriberQos subscriber_qos = SUBSCRIBER_QOS_DEFAULT;
    subscriber_qos.partition().push_back(reads);
    DataWriterQos writer_qos = DATAWRITER_QOS_DEFAULT;
    writer_qos.reliability().kind = RELIABLE_RELIABILITY_QOS;
    writer_qos.reliable_writer_qos().disable_positive_acks.enabled = true;
    writer_qos.reliable_writer_qos().times.heartbeatPeriod = {0, 5000000};
    writer_qos.reliable_writer_qos().times.nackResponseDelay = {0, 1000000};
    writer_qos.data_sharing().off();
    DataReaderQos reader_qos = DATAREADER_QOS_DEFAULT;
    reader_qos.reliability().kind = RELIABLE_RELIABILITY_QOS;
    reader_qos.reliable_reader_qos().disable_positive_ACKs.enabled = true;
    reader_qos.reliable_reader_qos().times.heartbeatResponseDelay = {0, 1000000};
    reader_qos.data_sharing().off();
    reader_qos.history().depth = 64;  // a notice and a reply may arrive together
    auto* publisher = peer->participant->create_publisher(publisher_qos);
    auto* subscriber = peer->participant->create_subscriber(subscriber_qos);
    if (topic && publisher && subscriber) {
      peer->writer = publisher->create_datawriter(topic, writer_qos, peer.get(), StatusMask::publication_matched());
      peer->reader = subscriber->create_datareader(topic, reader_qos, peer.get(), StatusMask::subscription_matched());
    }
  }
  if (!peer->writer || !peer->reader) return nullptr;
  peer->thread = std::thread([opened = peer.get()] { opened->run(); });
  return peer.release();
} catch (const std::exception&) {  // without a file descriptor or a thread
  return nullptr;
}

// For tests in virtual time: no participant and no thread. A writer is called for each message.
void* epson_rtmc_without_dds(Writer writer) {
  auto* peer = new Peer;
  peer->other_writer = writer;
  return peer;
}

// For tests in virtual time: as if a message had arrived.
void epson_rtmc_receive(void* handle, const uint8_t* data, uint32_t size, double time, uint64_t sender) {
  static_cast<Peer*>(handle)->receive({time, sender, static_cast<int>(size), Bytes(data, data + size)});
}

// Returns a file descriptor that is readable when epson_rtmc_take returns something.
int epson_rtmc_event(void* handle) { return static_cast<Peer*>(handle)->event; }

// Returns whether a peer is matched. Nothing is sent to it.
int epson_rtmc_matched(void* handle) { return static_cast<Peer*>(handle)->matched(); }

// Returns 1, 0 without a matched peer (nothing is sent), or -1 if Fast DDS refuses the message.
int epson_rtmc_write(void* handle, const uint8_t* data, uint32_t size) {
  return static_cast<Peer*>(handle)->write(Bytes(data, data + size));
}

// Sends a request after the earlier ones are answered. Returns as epson_rtmc_write, or 1 if it waits.
int epson_rtmc_request(void* handle, const uint8_t* data, uint32_t size) {
  auto* peer = static_cast<Peer*>(handle);
  std::lock_guard<std::mutex> lock(peer->mutex);
  peer->waiting.emplace_back(data, data + size);
  return peer->send_next();
}

// Sends targets from now on: at first this one, until there are others.
int epson_rtmc_start(void* handle, const double* target) {
  auto* peer = static_cast<Peer*>(handle);
  std::lock_guard<std::mutex> lock(peer->mutex);
  std::copy(target, target + 6, peer->last.begin());
  peer->targets.clear();
  peer->taken = peer->replaceable_to = 0;
  peer->late = false;
  peer->moving = true;
  return peer->send_next();
}

// Replaces all targets from an index on. Those after the first `planned` ones brake to rest, after which the last one is
// repeated. Returns 0 and changes nothing if that index, or a target that brakes, has been sent, or if Python is late.
int epson_rtmc_replace(void* handle, uint64_t first, const double* targets, uint32_t count, uint32_t planned) {
  auto* peer = static_cast<Peer*>(handle);
  std::lock_guard<std::mutex> lock(peer->mutex);
  if (first < peer->taken || first > peer->replaceable_to || (peer->late && planned)) return 0;
  peer->targets.resize(first - peer->taken);
  for (const double* end = targets + 6 * count; targets != end; targets += 6) {
    peer->targets.emplace_back();
    std::copy(targets, targets + 6, peer->targets.back().begin());
  }
  peer->replaceable_to = first + planned;
  return 1;
}

// Reports also the messages that are sent, with the sender 0.
void epson_rtmc_trace(void* handle, int on) { static_cast<Peer*>(handle)->tracing = on; }

// Sends no more targets.
void epson_rtmc_end(void* handle) {
  auto* peer = static_cast<Peer*>(handle);
  std::lock_guard<std::mutex> lock(peer->mutex);
  peer->moving = false;
}

// Returns the number of targets that were sent.
uint64_t epson_rtmc_taken(void* handle) {
  auto* peer = static_cast<Peer*>(handle);
  std::lock_guard<std::mutex> lock(peer->mutex);
  return peer->taken;
}

// Returns the size of a message, 0 without one, -1 if a peer was lost, or -2 after a failure of this library.
int epson_rtmc_take(void* handle, uint8_t* data, uint32_t size, uint64_t* sender, double* time) {
  auto* peer = static_cast<Peer*>(handle);
  std::lock_guard<std::mutex> lock(peer->arrivals_mutex);
  while (!peer->arrivals.empty()) {
    const Arrival arrival = std::move(peer->arrivals.front());
    peer->arrivals.pop_front();
    if (arrival.data.size() > size) continue;
    *sender = arrival.sender;
    *time = arrival.time;
    std::copy(arrival.data.begin(), arrival.data.end(), data);
    return arrival.size;
  }
  eventfd_t events;
  if (peer->signalled) eventfd_read(peer->event, &events);
  peer->signalled = false;
  return 0;
}

// Messages that arrive from now on do not make the event readable (1), or do again (0).
void epson_rtmc_quiet(void* handle, int on) {
  auto* peer = static_cast<Peer*>(handle);
  std::lock_guard<std::mutex> lock(peer->arrivals_mutex);
  peer->quiet = on;
  if (!peer->arrivals.empty()) peer->wake();
}

}  // extern "C"
